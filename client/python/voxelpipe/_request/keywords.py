"""Which keywords name a target, and which are a mistaken option."""
from __future__ import annotations

import difflib
from typing import Iterable

from ..errors import UnknownOption

# Options of the command line that are none here, and what takes their place.
_COMMAND_LINE = {
    "allow_outside": "use load_mesh(path, allow_outside=True)",
    "compress": "use compression=",
    "deadline_ms": "use timeout=, in seconds",
    "format": "a target's format is part of its text ('normal:f32'); that of a file follows from save('a.npz')",
    "grid_like": "use like=",
    "input_format": "use load_mesh(path, format='stl')",
    "json": "read the result's summary",
    "output": "use save('a.npz') of the result",
    "preview": "use save('a.png') of the result",
    "recursive": "list the files by pathlib.Path.rglob",
    "repeat": "call again",
    "simd": "only the command line has it",
    "target": "use targets=",
    "threads": "only the command line has it",
    "token_file": "use Client(address, token_file=...)",
    "tls": "use Client(address, tls=True)",
    "tls_ca": "use Client(address, tls=Tls(...))",
    "tls_cert": "use Client(address, tls=Tls(...))",
    "tls_key": "use Client(address, tls=Tls(...))",
    "tls_server_name": "use Client(address, tls=Tls(...))",
    "unit": "use load_mesh(path, unit='mm')",
    "view": "only the command line has it",
}
# Options of single functions of this package.
_OTHER_CALLS = ("errors", "in_flight", "max_result_bytes", "new_positions", "progress", "retries", "server", "timeout")
# Usual names of targets that are close to an option.
_TARGETS = ("label", "motion", "part")
_NEAR = 0.8  # of difflib: 'resolutoin' is as near, 'normal' and every shader's name are not


def check_target_names(names: Iterable[str], options: Iterable[str]) -> None:
    """Refuses keywords that are options by mistake. In: the keywords that are no options; all options of a request.

    Errors: UnknownOption for a name that is an option of the command line or of another function, or close to an option
    of a request (difflib's ratio of 0.8 or more).
    """
    known = list(options)
    for name in names:
        if name in _COMMAND_LINE:
            hint = _COMMAND_LINE[name]
            raise UnknownOption(f"{name}: is an option of the command line, not of this call; {hint}", name)
        if name in _OTHER_CALLS:
            raise UnknownOption(f"{name}: this call has no such option", name)
        if name in _TARGETS:
            continue
        nearest = difflib.get_close_matches(name.lower(), known, 1, _NEAR)
        if nearest:
            raise UnknownOption(
                f"{name}: there is no such option; did you mean {nearest[0]}=? A target of this name goes into "
                f"targets=[Target(name={name!r}, ...)]",
                name,
            )
