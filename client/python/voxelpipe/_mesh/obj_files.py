"""Puts the material libraries and textures of an OBJ file into it, as data: URIs. Source: RFC 2397."""
from __future__ import annotations

import base64
import os
import pathlib
import re
import urllib.parse
from typing import Iterator

from ..errors import InvalidMesh

_STATEMENTS = frozenset(b"v vt vn f fo p l usemtl mtllib g o s mg lod bevel c_interp d_interp".split())
_LINE = re.compile(rb"[^\r\n]*(?:\r\n|\r|\n|\Z)")
# Words behind an option of a texture; of those with 3, as many as are numbers.
_OPTIONS = {b"-o": 3, b"-s": 3, b"-t": 3, b"-mm": 2}
_OPTIONS.update(
    dict.fromkeys(b"-blendu -blendv -boost -bm -cc -clamp -colorspace -imfchan -texres -type".split(), 1)
)
_TYPES = {".jpg": "image/jpeg", ".jpeg": "image/jpeg", ".webp": "image/webp", ".png": "image/png"}


def needs_packing(data: bytes | memoryview) -> bool:
    """True if the text is an OBJ file with a statement mtllib that names a file."""
    text = bytes(data[:4096]).removeprefix(b"\xef\xbb\xbf")
    for line in re.split(rb"[\r\n]+", text):
        words = line.split()
        if words and not words[0].startswith(b"#"):
            if words[0] not in _STATEMENTS:
                return False
            break
    if b"mtllib" not in (text := bytes(data)):
        return False
    return any(_library_names(line) for line in _lines(text))


def pack(data: bytes | memoryview, path: pathlib.Path, allow_outside: bool) -> bytes:
    """The same file with those files in it. In: the file's bytes and path.

    Only files inside the folder of `path`, links resolved, are read, unless allow_outside. What is missing, or lies
    elsewhere, stays a name, of which the server warns. A texture is written once, with its name; a library where it is
    named first, and it is left out of later statements.
    """
    packer = _Packer(path.parent, allow_outside)
    return b"".join(packer.line(line) for line in _lines(bytes(data)))


def _lines(text: bytes) -> Iterator[bytes]:
    """The lines with their ends."""
    return (match[0] for match in _LINE.finditer(text) if match[0])


def _library_names(line: bytes) -> bytes:
    """What a statement mtllib names, if it is no data: URI."""
    words = line.split(None, 1)
    if len(words) < 2 or words[0] != b"mtllib":
        return b""
    names = words[1].strip()
    return b"" if names[:5].lower() == b"data:" else names


def _escape(text: bytes | str) -> bytes:
    """Percent escapes for what would end a word, a line or the head of the URI."""
    return urllib.parse.quote(text, safe="!$&()*+/:=?@[]^`{|}<>").encode()


def _map_name(arguments: bytes) -> bytes:
    """The name behind the options of a texture statement."""
    rest = arguments.strip()
    while rest.startswith(b"-"):
        option, _, behind = rest.partition(b" ")
        count = _OPTIONS.get(option.lower())
        if count is None:
            break
        rest = behind.strip()
        for _ in range(count):
            word, _, behind = rest.partition(b" ")
            if count == 3 and not re.fullmatch(rb"[+-]?(\d+\.?\d*|\.\d+)([eE][+-]?\d+)?", word):
                break
            rest = behind.strip()
    return rest


class _Packer:
    def __init__(self, folder: pathlib.Path, allow_outside: bool) -> None:
        self._folder = folder
        self._allow_outside = allow_outside
        self._paths: dict[tuple[bytes, pathlib.PurePosixPath], pathlib.Path | None] = {}
        self._libraries: set[pathlib.Path] = set()  # those written
        self._images: dict[pathlib.Path, bytes] = {}  # those written, and their names
        self._names: set[bytes] = set()

    def line(self, line: bytes) -> bytes:
        """A line of the OBJ file, packed."""
        names = _library_names(line)
        if not names:
            return line
        packed = self._library(names)
        if packed is None:
            libraries = [(name, self._library(name)) for name in names.split()]
            packed = b"".join(b" " + name if library is None else library for name, library in libraries)
        end = line[len(line.rstrip(b"\r\n")) :]
        return b"mtllib" + packed + end

    def _library(self, name: bytes) -> bytes | None:
        """A space and the library's data: URI, nothing if it is written already; None if it cannot be read."""
        path = self._path(name, pathlib.PurePosixPath())
        if path in self._libraries:
            return b""
        data = self._read(name, pathlib.PurePosixPath())
        if path is None or data is None:
            return None
        self._libraries.add(path)
        folder = pathlib.PurePosixPath(_text(name)).parent
        parts = [b" data:model/mtl;name=", _escape(name), b","]
        for line in _lines(data):
            words = line.split(None, 1)
            image = None
            if len(words) == 2 and words[0].lower() in (b"map_kd", b"map_ke"):
                file = _map_name(words[1])
                image = self._image(file, folder)
            if image is None:
                parts.append(_escape(line))
            else:
                parts += [_escape(line[: line.rindex(file)]), image, b"%0A"]
        return b"".join(parts)

    def _image(self, name: bytes, folder: pathlib.PurePosixPath) -> bytes | None:
        """What names a texture in the library: a data: URI at first, then its name there."""
        if not name or name[:5].lower() == b"data:":
            return None
        path = self._path(name, folder)
        if path in self._images:
            return _escape(self._images[path])
        data = self._read(name, folder)
        if path is None or data is None:
            return None
        unique = name if name not in self._names else name + b"#%d" % len(self._images)
        self._names.add(name)
        self._images[path] = unique
        kind = _TYPES.get(path.suffix.lower(), "application/octet-stream")
        head = b";name=" + _escape(unique) + b";base64,"
        # The library is escaped as a whole, so what is escaped in it is escaped twice.
        return b"data:" + kind.encode() + _escape(head) + base64.b64encode(data)

    def _path(self, name: bytes, folder: pathlib.PurePosixPath) -> pathlib.Path | None:
        """The path of a file that may be read; None if there is none."""
        if (name, folder) not in self._paths:
            self._paths[name, folder] = self._find(name, folder)
        return self._paths[name, folder]

    def _find(self, name: bytes, folder: pathlib.PurePosixPath) -> pathlib.Path | None:
        text = _text(name)
        if text.startswith("/") or text[1:2] == ":" or "\0" in text:
            return None
        root = self._folder.resolve()
        try:
            path = (root / folder / text).resolve()
            if self._allow_outside or os.path.commonpath([root, path]) == str(root):
                return path
            if path.exists():
                shown = name.decode(errors="replace")
                raise InvalidMesh(
                    f"the file '{shown}' lies outside of the OBJ file's folder; allow_outside=True reads it",
                    field="mesh",
                )
            return None
        except OSError:
            return None

    def _read(self, name: bytes, folder: pathlib.PurePosixPath) -> bytes | None:
        """The bytes of a file; None if it cannot be read, then the name leads to no file from now on."""
        path = self._path(name, folder)
        try:
            return path.read_bytes() if path is not None else None
        except OSError:
            self._paths[name, folder] = None
            return None


def _text(name: bytes) -> str:
    return os.fsdecode(name).replace("\\", "/")
