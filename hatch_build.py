"""The README of the package's metadata, where links to files of the source lead nowhere."""

from __future__ import annotations

import re
from pathlib import Path
from typing import Any

from hatchling.metadata.plugin.interface import MetadataHookInterface


class Readme(MetadataHookInterface):
    """README with links to the project's address; without pictures and links to files while it has none."""

    def update(self, metadata: dict[str, Any]) -> None:
        """Set the readme of the metadata."""
        text = (Path(self.root) / "README.md").read_text(encoding="utf-8")
        address = metadata.get("urls", {}).get("Source", "").rstrip("/")
        picture, link = r"!\[[^\]]*\]\((?!http)([^)]+)\)\n*", r"(?<!!)\[([^\]]*)\]\((?!http)([^)]+)\)"
        text = re.sub(picture, rf"![]({address}/raw/HEAD/\1)\n\n" if address else "", text)
        text = re.sub(link, rf"[\1]({address}/blob/HEAD/\2)" if address else r"\1", text)
        metadata["readme"] = {"content-type": "text/markdown", "text": text}
