"""Damaged inputs by the thousand: python benchmarks/fuzz.py [INPUTS_OF_EACH_KIND] [SEED]

Configurations with faults in their data and text, and damaged files of every kind that the program reads.  Each is
accepted, or refused in one sentence; an exception, a crash, more than 30 s of processor time or 1.5 GB of memory on top
is a fault.  Writes benchmarks/fuzz.csv: kind, inputs, accepted, refused, faults, seed.
"""

from __future__ import annotations

import random
import sys
import tempfile
from pathlib import Path

ROOT = Path(__file__).resolve().parents[1]
sys.path.insert(0, str(ROOT / "tests"))

import results  # noqa: E402
import test_fuzz_configurations  # noqa: E402
import test_fuzz_files  # noqa: E402
from fuzzing import Fault, attempt, mutated_document, seeds  # noqa: E402

AT_ONCE = 500
"""Files that one process reads: what it accumulates, and what a crash costs, stays small."""


def configurations(folder: Path, seed: int, count: int) -> tuple[int, list[str]]:
    """(documents accepted, faults)."""
    rng = random.Random(f"configuration/{seed}")
    documents = seeds(ROOT)
    test_fuzz_configurations.write_tables(folder)
    path = folder / "scene.yaml"
    accepted, faults = 0, []
    for i in range(count):
        text = mutated_document(rng, documents)
        path.write_bytes(text.encode("utf-8", "surrogatepass"))
        try:
            accepted += attempt(lambda: test_fuzz_configurations.look_at(path), f"configuration {i}:\n{text}")[0]
        except Fault as fault:
            faults.append(str(fault))
    return accepted, faults


def files(folder: Path, kind: str, seed: int, count: int) -> tuple[int, list[str]]:
    """(files accepted, faults)."""
    accepted, faults = 0, []
    for part in range(-(-count // AT_ONCE)):
        size = min(AT_ONCE, count - part * AT_ONCE)
        more, found = test_fuzz_files.run(folder, kind, 1000 * seed + part, size)
        accepted += more
        faults += found
    return accepted, faults


def main() -> None:
    count = int(sys.argv[1]) if len(sys.argv) > 1 else 2000
    seed = int(sys.argv[2]) if len(sys.argv) > 2 else 1
    rows = []
    for kind in ("configuration", *test_fuzz_files.KINDS):
        with tempfile.TemporaryDirectory() as name:
            run = configurations if kind == "configuration" else lambda *a, kind=kind: files(a[0], kind, *a[1:])
            accepted, faults = run(Path(name), seed, count)
        rows.append([kind, count, accepted, count - accepted - len(faults), len(faults), seed])
        print(f"{kind}: {count} inputs, {accepted} accepted, {len(faults)} faults", flush=True)
        for fault in faults[:10]:
            print(f"  {fault[:1500]}")
    results.write(Path(__file__).with_suffix(".csv"), ["kind", "inputs", "accepted", "refused", "faults", "seed"], rows)


if __name__ == "__main__":
    main()
