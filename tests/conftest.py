"""Types and shapes are checked in every test; a real browser for the tests of pages, if any."""

import shutil

import pytest

from tests import type_checks

# Before anything of cnca is imported: beartype checks each call, jaxtyping the shapes in it.
type_checks.install()

BROWSERS = ("chromium", "chromium-browser", "google-chrome")


@pytest.fixture(scope="session")
def browser():
    """Headless Chromium."""
    playwright = pytest.importorskip("playwright.sync_api", reason="playwright is not installed")
    program = next(filter(None, map(shutil.which, BROWSERS)), None)
    if program is None:
        pytest.skip(f"none of {', '.join(BROWSERS)} is installed")
    with playwright.sync_playwright() as running:
        # Without its sandbox, which root in a container does not have: only our own pages open.
        chromium = running.chromium.launch(executable_path=program, args=["--no-sandbox"])
        yield chromium
        chromium.close()


@pytest.fixture
def open_page(browser):
    """Open an address in a fresh profile; a page that logs an error fails its test."""
    contexts, errors = [], []

    def open_(address, *, width=1100, height=900, scheme="light", context=None):
        if context is None:
            viewport = {"width": width, "height": height}
            context = browser.new_context(viewport=viewport, color_scheme=scheme)
            context.set_default_timeout(90_000)
            contexts.append(context)
        page = context.new_page()
        page.on("pageerror", lambda error: errors.append(str(error)))
        page.goto(address)
        return page

    yield open_
    for context in contexts:
        context.close()
    assert errors == []
