"""Links from a page to a file outside of docs/ become that file's name, once it is found there."""

import re
from pathlib import Path

from mkdocs.exceptions import PluginError

ROOT = Path(__file__).parents[1]
OUTSIDE = re.compile(r"\[([^\]]*)\]\(\.\./([^)#\s]+)[^)\s]*\)")


def on_page_markdown(markdown, page, **_):
    """The page, without links that only work in the repository."""

    def name(link):
        label, path = link.groups()
        if not (ROOT / path).exists():
            raise PluginError(f"{page.file.src_path}: links to ../{path}, which is not there")
        return label if label.strip("`") == path else f"{label} (`{path}`)"

    return OUTSIDE.sub(name, markdown)
