"""A disk that is full at any moment of any writer: one sentence, nothing half written."""

import ast
import errno
import resource
from contextlib import contextmanager
from pathlib import Path

import numpy as np
import pytest
import xarray
from filming import film
from numba.core.caching import FunctionCache
from PIL import Image
from rendering import call

import twilight
from twilight.base.errors import TwilightError, TwilightWarning
from twilight.base.extras import is_installed
from twilight.base.progress import silent
from twilight.base.whole_files import refusal, write_csv, write_json
from twilight.io.exr import write_channels
from twilight.io.netcdf import write_netcdf
from twilight.jit import machine_code
from twilight.show.encode import encode, write_exr
from twilight.show.film import Animation
from twilight.studies.camera.response import ResponseCurve, write_response
from twilight.studies.export.prague import write_folder
from twilight.transport.steps import distance_to_sphere

PACKAGE = Path(twilight.__file__).parent
WHOLE = {"whole_file", "whole_content", "whole_folder", "unfinished"}
WRITERS = {"write_text", "write_bytes", "savez", "savez_compressed", "savefig", "to_netcdf", "to_zarr", "copyfile",
           "tofile", "imwrite", "imsave", "writelines"}  # fmt: skip
ELSEWHERE = {
    "base/cache.py": "handed to store(), which writes it whole",
    "show/sliders.py": "in memory, for a page that is written whole",
    "cli/__init__.py": "/dev/null",
    "jit/ahead.py": "/dev/null",
    "jit/machine_code.py": "empty files, to be locked",
    "io/journal.py": "its journal grows line by line: a line that was cut is not read",
    "io/folder.py": "empties that journal",
    "studies/compare/worker.py": "a pipe, and /proc",
    "io/stored_image.py": "copies in a temporary folder",
    "io/air/__init__.py": "copies in a temporary folder",
}


def writes(call: ast.Call) -> bool:
    """Whether a call opens a file to write, or writes one."""
    name = call.func.attr if isinstance(call.func, ast.Attribute) else getattr(call.func, "id", "")
    modes = [a.value for a in call.args + [k.value for k in call.keywords if k.arg == "mode"]
             if isinstance(a, ast.Constant) and isinstance(a.value, str)]  # fmt: skip
    if name in ("open", "fdopen", "File"):
        return any(set(mode) & set("wax+") and len(mode) <= 3 for mode in modes)
    return name in WRITERS


def test_every_writer_of_the_package_writes_whole_files():
    """A writer that opens its own file would leave half of it behind."""
    seen = set()
    for path in sorted(PACKAGE.rglob("*.py")):
        place = path.relative_to(PACKAGE).as_posix()
        for scope in ast.walk(ast.parse(path.read_text(encoding="utf-8"))):
            if not isinstance(scope, ast.FunctionDef) or place == "base/whole_files.py":
                continue
            calls = [node for node in ast.walk(scope) if isinstance(node, ast.Call)]
            if not any(writes(one) for one in calls):
                continue
            names = {getattr(one.func, "id", getattr(one.func, "attr", "")) for one in calls}
            seen.add(place)
            assert names & WHOLE or place in ELSEWHERE, f"{place}: {scope.name} writes a file by itself"
    assert set(ELSEWHERE) <= seen


@contextmanager
def files_of_at_most(size: int):
    """A limit on the size of files stands for the disk."""
    soft, hard = resource.getrlimit(resource.RLIMIT_FSIZE)
    resource.setrlimit(resource.RLIMIT_FSIZE, (size, hard))
    try:
        yield
    finally:
        resource.setrlimit(resource.RLIMIT_FSIZE, (soft, hard))


def contents(folder: Path) -> dict[str, int]:
    return {path.relative_to(folder).as_posix(): path.stat().st_size for path in folder.rglob("*") if path.is_file()}


def assert_all_or_nothing(write, tmp_path: Path, grows: tuple[str, ...] = ()) -> None:
    """write: of a folder.  On a disk that fails within any of its files each of them is whole or absent."""
    whole_at = tmp_path / "whole"
    whole_at.mkdir()
    write(whole_at)
    whole = contents(whole_at)
    sizes = sorted(set(whole.values()))
    for i, limit in enumerate(sorted({0, sizes[0] // 2, *(size - 1 - size // 20 for size in sizes)})):
        folder = tmp_path / f"full-{i}"
        folder.mkdir()
        with files_of_at_most(limit), pytest.raises(TwilightError, match=r"File too large|left with -25") as refused:
            write(folder)
        assert "\n" not in str(refused.value)
        for name, size in contents(folder).items():
            assert name in grows or abs(size - whole[name]) <= 16, (limit, name)


def run(*words):
    """A command; its one sentence as a TwilightError."""
    done = call(*words)
    if done.exit_code:
        assert done.exit_code == 2 and "Traceback" not in done.stderr, done.stderr
        last = done.stderr.strip().splitlines()[-1]
        assert last.startswith("twilight: "), done.stderr
        raise TwilightError(last)


def test_every_file_of_a_render(plain, tmp_path):
    """A full disk would leave half a file under its final name."""
    words = ("render", "pure-air", "--sun-elevation", "5", "--projection", "fisheye", "--size", "16x16", "--disc")
    every = "view,png,rgb,spectral,h5,sun,disc"
    assert_all_or_nothing(
        lambda at: run(*words, "--only", every, "--output", at / "out"), tmp_path, grows=("out/skies.jsonl",)
    )
    words = ("render", "pure-air", "--sun-elevation", "5,4", "--only", "h5,png", "--output")
    (tmp_path / "series").mkdir()
    assert_all_or_nothing(lambda at: run(*words, at / "out"), tmp_path / "series", grows=("out/skies.jsonl",))


@pytest.mark.parametrize("suffix", [".mp4", ".gif", ".webp", ""])
def test_films(suffix, tmp_path, monkeypatch):
    """ffmpeg would leave a film without its end, and the command would call it made."""
    if suffix == ".mp4" and not is_installed("imageio_ffmpeg"):
        pytest.skip("needs imageio-ffmpeg")
    pictures = []
    for i, noise in enumerate(np.random.default_rng(0).integers(0, 255, (4, 64, 64, 3), dtype=np.uint8)):
        path = tmp_path / f"{i}{'.png' if suffix else '.exr'}"
        Image.fromarray(noise).save(path) if suffix else write_exr(noise / 255.0, np.ones((64, 64)), path, {})
        pictures.append(path)
    if suffix:
        assert_all_or_nothing(lambda at: encode(pictures, at / f"film{suffix}", 25.0, silent), tmp_path)
        return
    monkeypatch.delattr("os.link")  # as on a disk that has no links
    assert_all_or_nothing(lambda at: encode(pictures, at / "film", 25.0, silent), tmp_path)


def test_a_film_that_could_not_begin_leaves_no_folder(tmp_path, monkeypatch):
    """A folder of nothing would be left."""

    def full(*_):
        assert [path.name for path in (tmp_path / "film.gif.frames").iterdir()] == ["lock"]
        raise TwilightError("No space left on device")

    monkeypatch.setattr(Animation, "_parts", full)
    with pytest.raises(TwilightError, match="No space left"):
        film(tmp_path / "film.gif").make()
    assert not list(tmp_path.iterdir())


CURVE = np.linspace(0.0, 1.0, 64)
SINGLE = {
    "x.csv": lambda path: write_csv(path, ["a", "b"], [[i, i] for i in range(500)]),
    "x.json": lambda path: write_json(path, list(range(500))),
    "x.nc": lambda path: write_netcdf(xarray.Dataset({"a": ("x", np.random.default_rng(0).random(3000))}), path),
    "x.exr": lambda path: write_channels(path, {"Y": np.random.default_rng(0).random((64, 64))}),
    "tables": lambda path: write_folder(path, {"a.bin": bytes(3000), "b/c.bin": bytes(9000)}),
    "response.csv": lambda path: write_response(path, ResponseCurve(CURVE, np.stack([CURVE] * 3, 1), residual=0.0)),
}


@pytest.mark.parametrize("name", SINGLE)
def test_every_kind_of_file(name, tmp_path):
    """What a library raises on a full disk (OpenEXR and HDF5: a RuntimeError) would be a traceback."""
    assert_all_or_nothing(lambda folder: SINGLE[name](folder / name), tmp_path)


def test_what_the_system_refuses_is_known_in_the_words_of_a_library():
    """A full disk within OpenEXR would be a traceback."""
    assert refusal(RuntimeError('Failed to write "a.exr". No space left on device.')) == "No space left on device"
    assert refusal(OSError(errno.ENOSPC, "No space left on device")) == "No space left on device"
    assert refusal(RuntimeError("not enough frames")) is None and refusal(ValueError("3 > 2")) is None


def test_kernels_that_cannot_be_kept_run_all_the_same(monkeypatch):
    """numba would end the first command on a machine whose disk is full."""
    monkeypatch.setattr(machine_code, "_warned", [])

    def refuse(*_):
        raise OSError(errno.ENOSPC, "No space left on device")

    monkeypatch.setattr(FunctionCache, "save_overload", refuse)
    kept = [machine_code.KernelCache(distance_to_sphere) for _ in "ab"]
    with pytest.warns(TwilightWarning, match=r"cannot be kept in .* \(No space left.*NUMBA_CACHE_DIR") as said:
        for one in kept:
            one.save_overload("signature", "data")
    assert len(said) == 1
