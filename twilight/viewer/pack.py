"""Arrays as a page carries them: logarithms in 16 bits, compressed, in base64."""

from __future__ import annotations

import base64
import gzip
import json
from dataclasses import dataclass, field
from typing import Any

import numpy as np

LEVELS = 65535
"""Largest sample of 16 bits."""


@dataclass
class Pack:
    """Named arrays in one stretch of bytes, and what a reader must know of each."""

    header: dict[str, Any]
    arrays: dict[str, Any] = field(default_factory=dict)
    parts: list[bytes] = field(default_factory=list)

    def logarithm(self, name: str, logs: np.ndarray) -> None:
        """Add logarithms of light in 16 bits.

        Stored are differences along the last axis, modulo 65536: first all high bytes, then all low ones.
        """
        low, high = float(logs.min()), float(logs.max())
        step = max(high - low, 1e-9) / LEVELS
        whole = np.rint((logs - low) / step).astype(np.int64)
        change = np.diff(whole, axis=-1, prepend=0) % 65536
        self._add(
            name, logs.shape, (change >> 8).astype(np.uint8).tobytes() + (change & 255).astype(np.uint8).tobytes()
        )
        self.arrays[name] |= {"kind": "log16", "low": low, "step": step}

    def numbers(self, name: str, values: np.ndarray) -> None:
        """Add values as float32."""
        self._add(name, np.shape(values), np.ascontiguousarray(values, "<f4").tobytes())
        self.arrays[name] |= {"kind": "float32"}

    def _add(self, name: str, shape: tuple[int, ...], content: bytes) -> None:
        start = sum(map(len, self.parts))
        self.arrays[name] = {"shape": list(shape), "start": start, "bytes": len(content)}
        # the next one starts where a reader may look at four bytes as a number
        self.parts.append(content + bytes(-len(content) % 4))

    def text(self) -> tuple[str, str]:
        """The header as JSON that may stand in HTML, and the arrays in base64."""
        head = json.dumps({**self.header, "arrays": self.arrays}, allow_nan=False).replace("<", "\\u003c")
        return head, base64.b64encode(gzip.compress(b"".join(self.parts), 9, mtime=0)).decode()
