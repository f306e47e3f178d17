"""A real browser for the tests of the pages we write; they are skipped where there is none."""

import os
import shutil
import subprocess
from pathlib import Path

import pytest

NAMES = ("chromium", "chromium-browser", "google-chrome", "chrome")
BROWSER = os.environ.get("RAILINSPECT_CHROMIUM") or next(
    filter(None, map(shutil.which, NAMES)), None
)
FLAGS = (
    "--headless",
    "--no-sandbox",
    "--disable-gpu",
    "--disable-quic",
    "--no-first-run",
    "--disable-background-networking",
    "--disable-component-update",
    "--disable-sync",
    "--hide-scrollbars",
    "--window-size=1280,1500",
)

needs_browser = pytest.mark.skipif(
    BROWSER is None,
    reason=f"no browser: none of {', '.join(NAMES)} is installed and RAILINSPECT_CHROMIUM is unset",
)


def browse(page: Path, *options: str, at: str = "") -> str:
    """Open a page, at a place in it, and return what the browser prints."""
    command = [
        str(BROWSER),
        *FLAGS,
        f"--user-data-dir={page.parent / 'profile'}",
        *options,
        page.as_uri() + (f"#{at}" if at else ""),
    ]
    done = subprocess.run(command, capture_output=True, text=True, timeout=120, check=False)
    assert done.returncode == 0, done.stderr[-2000:]
    return done.stdout
