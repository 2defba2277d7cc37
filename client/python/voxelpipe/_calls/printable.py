"""Text for a terminal."""
from __future__ import annotations

import re

# C0, DEL and C1, which steer terminals, separators of lines, the controls of bidirectional text, and halves of pairs.
_CONTROLS = re.compile("[\x00-\x1f\x7f-\x9f\u061c\u200e\u200f\u2028-\u202e\u2066-\u2069\ud800-\udfff]")


def printable(text: str) -> str:
    """The text with "?" for every character that could steer a terminal. It may come from a file or from a server."""
    return _CONTROLS.sub("?", text)
