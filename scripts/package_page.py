"""Build hook: the README as a package index shows it, where a path into this tree leads nowhere.

The address of the repository stands in one place: ``[tool.hatch.metadata.hooks.custom]`` in ``pyproject.toml``. With
it, links and pictures become absolute and the package names its project's pages. Without, links are their text alone
and pictures are left out, so that what is built points to nothing that is not there; ``scripts/release`` then refuses.
"""

from __future__ import annotations

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


class PackagePage(MetadataHookInterface):
    """Fills ``readme`` and ``urls``."""

    def update(self, metadata: dict) -> None:
        """Called by hatchling with the table ``project``."""
        repository = self.config.get("repository", "").rstrip("/")
        text = Path(self.root, "README.md").read_text(encoding="utf-8")
        metadata["readme"] = {"content-type": "text/markdown", "text": page(text, repository)}
        if repository:
            metadata["urls"] = {
                "Homepage": repository,
                "Source": repository,
                "Issues": f"{repository}/issues",
                "Changelog": f"{repository}/blob/main/CHANGELOG.md",
            }


def page(text: str, repository: str) -> str:
    """``text`` with absolute links, as GitHub and GitLab have them for a branch; without ``repository`` with none."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if not repository:
            return "" if picture else words
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/main/{target})"

    return _LINK.sub(absolute, text)
