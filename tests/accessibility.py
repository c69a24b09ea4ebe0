"""The accessibility check of pages: labels, roles, headings, contrast."""

from pathlib import Path

CHECK = Path(__file__).with_suffix(".js").read_text(encoding="utf-8")


def complaints(page) -> list[str]:
    """What readers who do not see well would miss on a Playwright page."""
    return page.evaluate(CHECK)
