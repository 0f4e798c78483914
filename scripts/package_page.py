"""A build hook that writes the README for a package index, on which relative paths lead nowhere.

The address of the repository is in one place: ``[tool.hatch.metadata.hooks.custom]`` in ``pyproject.toml``. With it,
links and pictures become absolute, and the package names its project's pages. Without it, links are reduced to their
text and pictures are left out, so that the package has no dead links; ``scripts/release`` then refuses it.
"""

from __future__ import annotations

import re
from pathlib import Path

from hatchling.metadata.plugin.interface import MetadataHookInterface

_LINK = re.compile(r"(!?)\[([^\]]*)\]\((?!https?:|#)([^)\s]+)\)")


class PackagePage(MetadataHookInterface):
    """A hook that fills in ``readme`` and ``urls``."""

    def update(self, metadata: dict) -> None:
        """Fill in the table ``project``; hatchling calls this."""
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
    """Return ``text`` with absolute links of GitHub or GitLab; without ``repository``, with no links."""

    def absolute(link: re.Match[str]) -> str:
        picture, words, target = link.groups()
        if not repository:
            return "" if picture else words
        return f"{picture}[{words}]({repository}/{'raw' if picture else 'blob'}/main/{target})"

    return _LINK.sub(absolute, text)
