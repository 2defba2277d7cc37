"""Packs a glTF file and the files that it names into one GLB. Source: glTF 2.0 specification, 3.6 and 4.4."""
from __future__ import annotations

import json
import os
import pathlib
import re
import struct
import urllib.parse
from typing import Any

from ..errors import InvalidMesh
from .glb import glb_of

_MESHOPT = ("EXT_meshopt_compression", "KHR_meshopt_compression")
_IMAGES = (
    (b"\x89PNG", "image/png"),
    (b"\xff\xd8\xff", "image/jpeg"),
    (b"RIFF", "image/webp"),
    (b"\xabKTX", "image/ktx2"),
)


def needs_packing(data: bytes | memoryview) -> bool:
    """True if a glTF or GLB file names other files. False also for what is neither, and for a broken one."""
    document, _ = _split(data)
    return document is not None and any(_file_uri(entry) is not None for entry in _named_files(document))


def pack(data: bytes | memoryview, path: pathlib.Path, allow_outside: bool) -> bytes:
    """A GLB that needs no other file. In: the file's bytes and path.

    Only files inside the folder of `path`, links resolved, are read, unless allow_outside. An image that is missing, or
    that lies elsewhere, stays a name, of which the server warns if a shader reads it. Errors: InvalidMesh naming the
    URI of a buffer.
    """
    document, binary = _split(data)
    assert document is not None
    packer = _Packer(path.parent, allow_outside)
    images = packer.read_images(document)
    if not images and not any(_file_uri(buffer) is not None for buffer in _objects(document, "buffers")):
        return bytes(data)
    packer.take_buffers(document, binary)
    packer.take_images(document, images)
    document["buffers"][0]["byteLength"] = packer.size
    return glb_of(document, packer.parts)


def _split(data: bytes | memoryview) -> tuple[dict[str, Any] | None, bytes | None]:
    """The JSON of a file and the GLB's BIN chunk; None if it is no glTF."""
    text: bytes = bytes(data[:4])
    binary: bytes | None = None
    if text == b"glTF":
        if len(data) < 20:
            return None, None
        (length,) = struct.unpack_from("<I", data, 12)
        text = bytes(data[20 : 20 + length])
        at = 20 + length
        if at + 8 <= len(data):
            size, kind = struct.unpack_from("<I4s", data, at)
            if kind == b"BIN\0":
                binary = bytes(data[at + 8 : at + 8 + size])
    elif text.lstrip(b"\xef\xbb\xbf \t\r\n")[:1] in (b"{", b""):
        text = bytes(data)
    else:
        return None, None
    try:
        document = json.loads(text.decode("utf-8-sig"))
    except (ValueError, RecursionError):
        return None, None
    return (document, binary) if isinstance(document, dict) else (None, None)


def _named_files(document: dict[str, Any]) -> list[dict[str, Any]]:
    named = [*_objects(document, "buffers"), *_objects(document, "images")]
    return named


def _objects(document: dict[str, Any], key: str) -> list[dict[str, Any]]:
    entries = document.get(key)
    return [entry for entry in entries if isinstance(entry, dict)] if isinstance(entries, list) else []


def _file_uri(entry: dict[str, Any]) -> str | None:
    uri = entry.get("uri")
    return uri if isinstance(uri, str) and not uri[:5].lower() == "data:" else None


class _Packer:
    def __init__(self, folder: pathlib.Path, allow_outside: bool) -> None:
        self._folder = folder
        self._allow_outside = allow_outside
        self.parts: list[bytes] = []
        self.size = 0
        self._merged: dict[pathlib.Path, tuple[int, int, int]] = {}  # files of buffers: offset, bytes there, bytes

    def take_buffers(self, document: dict[str, Any], binary: bytes | None) -> None:
        """Merges the buffers that are files, and the BIN chunk, into buffer 0; the others follow it."""
        merged: dict[int, int] = {}
        kept: list[dict[str, Any]] = []
        moved: dict[int, int] = {}
        for i, buffer in enumerate(_objects(document, "buffers")):
            uri = _file_uri(buffer)
            if uri is not None:
                merged[i] = self._add_buffer(buffer, uri, f"buffer {i}")
            elif i == 0 and binary is not None and "uri" not in buffer:
                merged[i] = self._add(binary)
            else:
                moved[i] = len(kept) + 1
                kept.append(buffer)
        document["buffers"] = [{"byteLength": self.size}, *kept]
        for view in _objects(document, "bufferViews"):
            extensions = view.get("extensions")
            places = [extensions.get(name) for name in _MESHOPT] if isinstance(extensions, dict) else []
            for place in [view, *places]:
                if not isinstance(place, dict) or not isinstance(place.get("buffer"), int):
                    continue
                old = place["buffer"]
                if old in merged:
                    place["buffer"] = 0
                    offset = place.get("byteOffset", 0)
                    place["byteOffset"] = offset + merged[old] if isinstance(offset, int) else offset
                elif old in moved:
                    place["buffer"] = moved[old]

    def read_images(self, document: dict[str, Any]) -> dict[str, tuple[pathlib.Path, bytes]]:
        """The files of the images, by URI; those that cannot or may not be read are left out."""
        images: dict[str, tuple[pathlib.Path, bytes]] = {}
        files: dict[pathlib.Path, bytes | None] = {}
        for i, image in enumerate(_objects(document, "images")):
            uri = _file_uri(image)
            if uri is None or uri in images:
                continue
            try:
                path = self._path_of(uri, f"image {i}")
                if path not in files:
                    files[path] = None
                    files[path] = path.read_bytes()
            except (OSError, InvalidMesh):
                continue
            if (data := files[path]) is not None:
                images[uri] = (path, data)
        return images

    def take_images(self, document: dict[str, Any], images: dict[str, tuple[pathlib.Path, bytes]]) -> None:
        """Puts images that are files into buffer 0, each file once."""
        places: dict[pathlib.Path, int] = {}  # their buffer views
        for image in _objects(document, "images"):
            uri = _file_uri(image)
            if uri is None or uri not in images:
                continue
            path, data = images[uri]
            if path not in places:
                views = document.setdefault("bufferViews", [])
                places[path] = len(views)
                views.append({"buffer": 0, "byteOffset": self._add(data), "byteLength": len(data)})
            del image["uri"]
            image["bufferView"] = places[path]
            image["mimeType"] = next((kind for magic, kind in _IMAGES if data.startswith(magic)), "image/png")

    def _add_buffer(self, buffer: dict[str, Any], uri: str, place: str) -> int:
        """The offset at which the bytes of a buffer's file lie in buffer 0."""
        path = self._path_of(uri, place)
        length = buffer.get("byteLength")
        known = self._merged.get(path)
        if known is not None:
            offset, there, size = known
            if (length if isinstance(length, int) else size) <= there:
                return offset
        try:
            data = path.read_bytes()
        except OSError as error:
            raise InvalidMesh(f"{place}: URI '{uri}': {error.strerror}", field=place) from error
        if isinstance(length, int) and length > len(data):
            raise InvalidMesh(f"{place}: '{uri}' has {len(data)} bytes, and byteLength is {length}", field=place)
        # A second, longer part of a file brings all of it: there is no third.
        part = data[:length] if isinstance(length, int) and known is None else data
        offset = self._add(part)
        self._merged[path] = (offset, len(part), len(data))
        return offset

    def _add(self, data: bytes) -> int:
        """The offset at which the bytes lie in buffer 0."""
        at = self.size
        padding = -len(data) % 4
        self.parts += [data, b"\0" * padding]
        self.size += len(data) + padding
        return at

    def _path_of(self, uri: str, place: str) -> pathlib.Path:
        name = urllib.parse.unquote(uri)
        if re.match(r"[A-Za-z][A-Za-z0-9+.-]*:", uri) or name.startswith("/") or "\\" in name or "\0" in name:
            raise InvalidMesh(f"{place}: URI '{uri}' is no relative path", field=place)
        root = self._folder.resolve()
        path = (root / name).resolve()
        if not self._allow_outside and os.path.commonpath([root, path]) != str(root):
            raise InvalidMesh(
                f"{place}: URI '{uri}' lies outside of the file's folder; allow_outside=True reads it", field=place
            )
        return path
