"""Text of files and of users: what may be a label, and how any text reaches a terminal or a table."""

from __future__ import annotations

import re

#: Control characters, line ends of all kinds, marks that turn the direction of writing, and what UTF-8 can't hold.
_UNSAFE = re.compile("[\x00-\x1f\x7f-\x9f\u2028\u2029\u202a-\u202e\u2066-\u2069\ud800-\udfff]")
#: Longer labels fill the tables they stand in.
LONGEST_LABEL = 200
#: So do longer titles.
LONGEST_TITLE = 2000


def printable(text: str, keep: str = "") -> str:
    r"""Return a text with escapes for characters that would move a cursor, break a table or can't be encoded."""
    return _UNSAFE.sub(lambda found: found[0] if found[0] in keep else f"\\u{ord(found[0]):04x}", text)


def label_fault(text: str, longest: int = LONGEST_LABEL) -> str:
    """Say why a text is no label: several lines, control characters, no UTF-8, or too long; "" where it is one."""
    found = _UNSAFE.search(text)
    if found:
        return (
            f"has the character {printable(found[0])}, which labels can't have: no line breaks, no control characters"
        )
    return f"has {len(text)} characters; at most {longest} will do" if len(text) > longest else ""
