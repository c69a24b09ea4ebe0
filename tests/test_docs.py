"""Every page is in the site's menu, and what pages link to is there."""

import re
from pathlib import Path

import pytest
import yaml

ROOT = Path(__file__).parents[1]
DOCS = ROOT / "docs"
PAGES = sorted(path.name for path in DOCS.iterdir() if path.suffix in (".md", ".ipynb"))
LINK = re.compile(r"\]\((?!https?://|#)([^)#\s]+)")


def _menu(entry) -> list[str]:
    """The pages of a nav entry of mkdocs.yml."""
    if isinstance(entry, str):
        return [entry]
    children = entry.values() if isinstance(entry, dict) else entry
    return [page for child in children for page in _menu(child)]


def test_the_menu_has_every_page_once():
    menu = _menu(yaml.safe_load((ROOT / "mkdocs.yml").read_text(encoding="utf-8"))["nav"])
    assert sorted(menu) == PAGES


@pytest.mark.parametrize("page", ["../README.md", "../CONTRIBUTING.md", *PAGES])
def test_links_lead_somewhere(page):
    links = LINK.findall((DOCS / page).read_text(encoding="utf-8"))
    assert [link for link in links if not (DOCS / page).parent.joinpath(link).exists()] == []


def test_the_notebook_is_stored_without_outputs():
    cells = yaml.safe_load((DOCS / "quickstart.ipynb").read_text(encoding="utf-8"))["cells"]
    code = [cell for cell in cells if cell["cell_type"] == "code"]
    assert code
    assert all(cell["outputs"] == [] and cell["execution_count"] is None for cell in code)
