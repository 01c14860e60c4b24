"""Machine code on disk: what it was made of, what of it is kept, and code that came with the program.

numba keeps the machine code of a kernel beside its module and drops it where that file has changed.  It does not see
that a kernel of another file, which became a part of it, has changed.  Here a kernel is known by a digest of its own
bytecode and options, of the constants that it reads, and of the same of every kernel that it calls, in whatever file:
what no longer is what it was is compiled again, and an edit of anything else is not noticed.

An inner kernel is never run by itself: it is kept as LLVM's code, to be linked into those that call it, and machine
code is made of them alone.

A wheel may bring machine code for processors of the level x86-64-v3 (`benchmarks/builders/wheel_kernels.py`).  Where
there is none of this very processor it is taken, if the processor has that level: what else is compiled stays native.

Reading machine code needs none of what compiling does: numba's registries, which take half a second with the parts of
scipy that they import, are loaded where something is compiled.
"""

from __future__ import annotations

import functools
import gc
import hashlib
import os
import sys
import warnings
from collections.abc import Iterator
from contextlib import contextmanager, suppress
from pathlib import Path
from types import CodeType, ModuleType
from typing import IO, Any

import llvmlite.binding as llvm
import numpy as np
from numba.core import environment
from numba.core.caching import CompileResultCacheImpl, FunctionCache, IndexDataCacheFile
from numba.core.codegen import JITCodeLibrary
from numba.core.compiler import Compiler, CompileResult
from numba.core.runtime import rtsys

from twilight.base.cache import FOLDER_VARIABLE, cache_folder
from twilight.base.errors import TwilightWarning

try:
    import fcntl
except ImportError:  # Windows, where no processes are forked
    fcntl = None  # type: ignore[assignment]

BASELINE = "x86-64-v3"
"""Level of processors for which a wheel brings machine code: of nearly all since 2013 to 2015."""
_BASELINE_FEATURES = ("avx", "avx2", "bmi", "bmi2", "f16c", "fma", "lzcnt", "movbe", "popcnt", "sse4.2")
"""What LLVM calls the parts of that level."""
_PACKAGE = __name__.partition(".")[0]
_LINKED = "linked"
"""Kind of a library that holds LLVM's code alone, in the files that numba keeps."""


class _LinkedLibrary(JITCodeLibrary):
    """The code of an inner kernel: linked into those that call it, never made machine code of."""

    @property
    def codegen(self) -> Any:
        """What sets the environment of a function that Python calls: there is none."""
        return _NoEnvironment

    def _optimize_final_module(self) -> None:
        """Take in what it calls, at the least cost: all is optimised as a part of each kernel that Python calls."""
        manager, builder = self._codegen._module_pass_manager(
            loop_vectorize=False, slp_vectorize=False, opt=0, cost="cheap"
        )
        manager.run(self._final_module, builder)

    def _finalize_final_module(self) -> None:
        self._finalize_dynamic_globals()
        self._verify_declare_only_symbols()
        self._finalized = True

    def get_pointer_to_function(self, name: str) -> int:
        """0: there is no machine code."""
        self._ensure_finalized()
        return 0

    def serialize_using_object_code(self) -> tuple[str, str, bytes]:
        """What is kept on disk."""
        return self.name, _LINKED, self._get_module_for_linking().as_bitcode()

    @classmethod
    def read(cls, codegen: Any, name: str, bitcode: bytes) -> _LinkedLibrary:
        """The library that was kept."""
        library = cls(codegen, name)
        library._final_module = library._shared_module = llvm.parse_bitcode(bitcode)
        library._finalized = True
        return library


class _NoEnvironment:
    @staticmethod
    def set_env(name: str, environment: Any) -> None:
        """Nothing."""


class InnerCompiler(Compiler):
    """numba's compiler, for inner kernels."""

    def define_pipelines(self) -> Any:
        """The usual passes, on a `_LinkedLibrary`."""
        self.state.library = _LinkedLibrary(self.state.targetctx.codegen(), self.state.func_id.func_qualname)
        self.state.library.enable_object_caching()
        return super().define_pipelines()


class _LinkingContext:
    """A target context that reads libraries as `_LinkedLibrary`, and is its own code generator."""

    def __init__(self, context: Any) -> None:
        self._context = context

    def __getattr__(self, name: str) -> Any:
        return getattr(self._context, name)

    def codegen(self) -> _LinkingContext:
        """Itself."""
        return self

    def unserialize_library(self, state: tuple[str, str, bytes]) -> _LinkedLibrary:
        """The library of what was kept."""
        return _LinkedLibrary.read(self._context.codegen(), state[0], state[2])


_UserProvided: Any
_InTree: Any
_UserProvided, _InTree, *_others = CompileResultCacheImpl._locator_classes
"""Where numba keeps files: NUMBA_CACHE_DIR; beside the module; in the user's folder."""


class _InCacheFolder(_UserProvided):
    """Files in TWILIGHT_CACHE_DIR, where the package's folder cannot be written."""

    def __init__(self, py_func: Any, py_file: str) -> None:
        super().__init__(py_func, py_file)
        self._cache_path = str(cache_folder() / "kernels" / self.get_suitable_cache_subpath(py_file))

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """The files of a function; None where there is no such folder, or none that can be written."""
        made = cls(py_func, py_file)
        try:
            if not os.environ.get(FOLDER_VARIABLE):
                return None
            made.ensure_cache_path()
        except OSError:
            return None
        return made


class _NotKept(_InTree):
    """Files in the package's folder, which are read there and cannot be written, where nothing can."""

    @classmethod
    def from_function(cls, py_func: Any, py_file: str) -> Any:
        """The files of a function."""
        return cls(py_func, py_file)


class _Files(CompileResultCacheImpl):
    _locator_classes = [_UserProvided, _InTree, _InCacheFolder, *_others, _NotKept]  # noqa: RUF012 - numba's own

    def rebuild(self, target_context: Any, payload: Any) -> Any:
        """A kernel from what was kept of it."""
        if payload[0][1] != _LINKED:
            return super().rebuild(target_context, payload)
        made = CompileResult._rebuild(_LinkingContext(target_context), *payload)
        return made._replace(target_context=target_context)


class KernelCache(FunctionCache):
    """What is kept of one kernel, by what it was made of.

    A kernel runs though its machine code cannot be kept, on a disk that is full, or not be read, for another version
    kept it, whose modules had other names.  It is kept beside its module, else in TWILIGHT_CACHE_DIR, else in numba's
    folder of the user; where none can be written, in none.
    """

    _impl_class = _Files

    def __init__(self, dispatcher: Any) -> None:
        super().__init__(dispatcher.py_func)
        self._dispatcher = dispatcher
        beside = Path(dispatcher.py_func.__code__.co_filename).parent / "__pycache__"
        self._shipped = IndexDataCacheFile(str(beside), self._impl.filename_base, None)
        self._is_stamped = False
        self._compiling: dict[str, IO[str]] = {}

    def _stamp(self) -> None:
        """Say what the kernel is made of: at the first call, when all modules are imported."""
        if not self._is_stamped:
            self._cache_file._source_stamp = self._shipped._source_stamp = digest_of(self._dispatcher)
            self._is_stamped = True

    def load_overload(self, sig: Any, target_context: Any) -> Any:
        """The kernel for types of arguments; None where it must be compiled."""
        self._stamp()
        rtsys.initialize(target_context)
        found = self._read(sig, target_context)
        if found is None and locks:
            file = self._lock_file(sig).open("w")
            with suppress(OSError):  # a file system without locks: it is compiled here too
                fcntl.flock(file, fcntl.LOCK_EX)
            found = self._read(sig, target_context)
            if found is None:
                self._compiling[str(sig)] = file
            else:
                file.close()
        return found

    def _load_overload(self, sig: Any, target_context: Any) -> Any:
        found = super()._load_overload(sig, target_context)
        if found is not None or not _has_baseline():
            return found
        kinds, (triple, *_), code = self._index_key(sig, target_context.codegen())
        payload = self._shipped.load((kinds, (triple, BASELINE, ""), code))
        return None if payload is None else self._impl.rebuild(target_context, payload)

    def _read(self, sig: Any, target_context: Any) -> Any:
        try:
            return self._load_overload(sig, target_context)
        except Exception:  # what unpickling raises depends on what is not there any more
            return None

    def _lock_file(self, sig: Any) -> Path:
        name = f"{self.cache_path} {self._impl.filename_base} {sig}"
        return locks[0] / hashlib.sha256(name.encode()).hexdigest()

    def is_taken(self, sig: Any) -> bool:
        """Whether another process is compiling it for these types of arguments."""
        with self._lock_file(sig).open("w") as file:
            try:
                fcntl.flock(file, fcntl.LOCK_EX | fcntl.LOCK_NB)
            except BlockingIOError:
                return True
            except OSError:
                return False
        return False

    def save_overload(self, sig: Any, data: Any) -> None:
        """Keep a kernel that was compiled."""
        try:
            try:
                super().save_overload(sig, data)
            except Exception as error:
                if isinstance(error, OSError):
                    raise
                self.flush()  # what is there is of another version
                super().save_overload(sig, data)
        except OSError as error:
            if not _warned:
                _warned.append(True)
                warnings.warn(
                    f"compiled kernels cannot be kept in {self.cache_path} ({error.strerror or error}): they are "
                    "compiled again the next time; TWILIGHT_CACHE_DIR or NUMBA_CACHE_DIR names another folder",
                    TwilightWarning,
                    stacklevel=2,
                )
        finally:
            if str(sig) in self._compiling:
                self._compiling.pop(str(sig)).close()


locks: list[Path] = []
"""The folder of a file for each kernel that is being compiled, locked by the process that does, where there are several
(`twilight.jit.ahead`)."""
_warned: list[bool] = []
"""Holds something once this process has said that kernels cannot be kept."""

_load_index = IndexDataCacheFile._load_index


def _load_known_index(file: Any) -> dict[Any, Any]:
    """The machine code that a cache file of numba's knows of; none where it is of types that are no longer there."""
    try:
        return _load_index(file)
    except (ImportError, AttributeError):
        return {}


IndexDataCacheFile._load_index = _load_known_index  # type: ignore[method-assign]

_rebuild = environment._rebuild_env


def _environment(module: str, *of: Any) -> Any:
    """What numba keeps beside machine code, of a function of a module; of one of numba's own that is not loaded,
    without the names of that module, which compiled code does not read: loading it takes scipy.linalg with it."""
    loaded = module in sys.modules or not module.startswith("numba.")
    return _rebuild(module if loaded else __name__, *of)


environment._rebuild_env = _environment


@functools.cache
def _has_baseline() -> bool:
    """Whether this processor runs machine code of `BASELINE`."""
    try:
        features = llvm.get_host_cpu_features()
    except RuntimeError:
        return False
    return all(features.get(name, False) for name in _BASELINE_FEATURES)


@contextmanager
def no_garbage_collection() -> Iterator[None]:
    """Python looks for circles of objects again and again while a compiler makes millions that stay: an eighth of its
    time."""
    was_on = gc.isenabled()
    gc.disable()
    try:
        yield
    finally:
        if was_on:
            gc.enable()


_digests: dict[Any, str] = {}
"""Of Python functions that are compiled, what `digest_of` found."""


def digest_of(kernel: Any) -> str:
    """SHA-256 of what the machine code of a kernel is made of.

    Its options, its bytecode, and all that its names stand for: constants by their values, kernels by this digest,
    other functions and modules of the program by the text of their file, those of others by their names.
    """
    function = kernel.py_func
    if function not in _digests:
        _digests[function] = ""  # a kernel that calls itself
        options = getattr(kernel, "targetoptions", {})
        made_of = tuple((name, options[name]) for name in sorted(options)), function.__defaults__
        found = hashlib.sha256(_described(made_of).encode())
        _add_code(found, function.__code__, function.__globals__)
        _digests[function] = found.hexdigest()
    return _digests[function]


def _add_code(found: Any, code: CodeType, names: dict[str, Any]) -> None:
    found.update(code.co_code)
    for constant in code.co_consts[1:] if code.co_consts[:1] and isinstance(code.co_consts[0], str) else code.co_consts:
        if isinstance(constant, CodeType):
            _add_code(found, constant, names)
        else:
            found.update(_described(constant).encode())
    for name in code.co_names:
        found.update(f"{name}={_described(names[name]) if name in names else ''};".encode())


def _described(value: Any) -> str:
    """A value that a kernel reads, as text that changes with it."""
    if hasattr(value, "py_func"):
        return digest_of(value)
    if isinstance(value, np.ndarray):
        return f"{value.dtype} {value.shape} {hashlib.sha256(np.ascontiguousarray(value).tobytes()).hexdigest()}"
    if isinstance(value, tuple):
        return f"({','.join(map(_described, value))})"
    if isinstance(value, set | frozenset):  # whose order is another in each process
        return f"{{{','.join(sorted(map(_described, value)))}}}"
    if isinstance(value, bool | int | float | complex | str | bytes | np.generic | None):
        return repr(value)
    if isinstance(value, type) and hasattr(value, "_fields"):
        return f"{value.__module__}.{value.__qualname__}{value._fields}"
    module = value.__name__ if isinstance(value, ModuleType) else str(getattr(value, "__module__", ""))
    if module.partition(".")[0] == _PACKAGE:
        return _text_of(module)
    return f"{module}.{getattr(value, '__name__', type(value).__name__)}"


def _text_of(module: str) -> str:
    """SHA-256 of the file of a module of the program."""
    if module not in _texts:
        _texts[module] = hashlib.sha256(Path(str(sys.modules[module].__file__)).read_bytes()).hexdigest()
    return _texts[module]


_texts: dict[str, str] = {}
