"""A headless browser with software WebGL 2 for tests of pages, served from loopback."""

import atexit
import functools
import http.server
import shutil
import threading
import time
from collections.abc import Iterator
from contextlib import contextmanager
from pathlib import Path
from typing import Any

import numpy as np
import pytest

NAMES = ("chromium-headless-shell", "chromium", "google-chrome")
OPTIONS = (
    "--no-sandbox", "--disable-quic", "--no-first-run", "--disable-background-networking",
    "--disable-component-update", "--disable-sync", "--use-angle=swiftshader", "--enable-unsafe-swiftshader",
)  # fmt: skip


class _Silent(http.server.SimpleHTTPRequestHandler):
    def log_message(self, *_: Any) -> None:
        pass


def program_of() -> str | None:
    """The browser of this machine."""
    return next((found for name in NAMES if (found := shutil.which(name))), None)


_running: dict[tuple[str, ...], Any] = {}
"""By its options the browser of the tests of one file: to start one takes half a processor second."""


def close_browser() -> None:
    """End it; while it runs nothing else in the process can run a loop of asyncio."""
    while _running:
        _, (playwright, browser) = _running.popitem()
        browser.close()
        playwright.stop()


atexit.register(close_browser)


def _browser(program: str) -> Any:
    if OPTIONS not in _running:
        close_browser()
        from playwright.sync_api import sync_playwright

        playwright = sync_playwright().start()
        _running[OPTIONS] = playwright, playwright.chromium.launch(executable_path=program, args=list(OPTIONS))
    return _running[OPTIONS][1]


@contextmanager
def open_page(
    path: Path, width: int = 320, height: int = 180, *, from_disk: bool = False, **options: Any
) -> Iterator[tuple[Any, list[str]]]:
    """A page of playwright's that has loaded `path`, and a list that errors of the console come into."""
    pytest.importorskip("playwright.sync_api", reason="needs the package playwright")
    program = program_of()
    if program is None:
        pytest.skip("needs a browser: apt-get install chromium-headless-shell")
    handler = functools.partial(_Silent, directory=str(path.parent))
    server = http.server.ThreadingHTTPServer(("127.0.0.1", 0), handler)
    threading.Thread(target=server.serve_forever, daemon=True).start()
    errors: list[str] = []
    try:
        page = _browser(program).new_page(viewport={"width": width, "height": height}, **options)
        page.on("console", lambda m: errors.append(m.text) if m.type == "error" else None)
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(path.as_uri() if from_disk else f"http://127.0.0.1:{server.server_port}/{path.name}")
        until(page, "!!window.twilight || document.querySelector('#message').innerText.includes('cannot')")
        assert page.evaluate("!!window.twilight"), f"{page.inner_text('#message')} {errors}"
        yield page, errors
        page.context.close()
    except BaseException:
        close_browser()
        raise
    finally:
        server.shutdown()


def until(page: Any, condition: str, seconds: float = 60.0) -> None:
    """Wait for a condition in a page, asked for from outside: a strict page evaluates no text of its own."""
    end = time.monotonic() + seconds
    while not page.evaluate(condition):
        assert time.monotonic() < end, condition
        time.sleep(0.05)


def light_of(page: Any, state: dict[str, Any]) -> np.ndarray:
    """X, Y, Z and scotopic luminance (height, width, 4) of the picture in a state, the lowest row first."""
    made = page.evaluate(
        """state => {
          twilight.set(state);
          twilight.draw();
          const p = twilight.light(), bytes = new Uint8Array(p.values.buffer);
          let text = "";
          for (let i = 0; i < bytes.length; i += 8192) text += String.fromCharCode(...bytes.subarray(i, i + 8192));
          return { width: p.width, height: p.height, text: btoa(text) };
        }""",
        state,
    )
    import base64

    values = np.frombuffer(base64.b64decode(made["text"]), "<f4")
    return values.reshape(made["height"], made["width"], 4)
