"""The classes of the service's messages, made of descriptors when they are imported.

protoc's own modules run with protobuf's runtimes of their major version and the next one alone
(protobuf.dev/support/cross-version-runtime-guarantee), and use names that are private to it. Descriptors and the
functions below are public in every version from 4.21 on.

The messages are in a pool of their own: they clash neither with a program's stubs of this service nor with the package
googleapis-common-protos. google/rpc is among them, as Debian 12 does not have that package.
"""
from __future__ import annotations

from typing import Any

from google.protobuf import descriptor_pb2, descriptor_pool, message_factory

from ._proto._files import FILES

_POOL = descriptor_pool.DescriptorPool()


class Enum:
    """An enum of a file, with what protoc's modules give of one."""

    def __init__(self, descriptor: Any) -> None:
        self._numbers: dict[str, int] = {value.name: value.number for value in descriptor.values}
        self._names = {number: name for name, number in self._numbers.items()}

    def Value(self, name: str) -> int:
        """Errors: KeyError."""
        return self._numbers[name]

    def Name(self, number: int) -> str:
        """Errors: KeyError."""
        return self._names[number]

    def items(self) -> list[tuple[str, int]]:
        """Names and numbers, in the order of the file."""
        return [*self._numbers.items()]


def _class_of(descriptor: Any) -> Any:
    if hasattr(message_factory, "GetMessageClass"):  # protobuf 4.22 and later
        return message_factory.GetMessageClass(descriptor)
    return message_factory.MessageFactory(_POOL).GetPrototype(descriptor)


def _names_in(descriptor: Any) -> dict[str, Any]:
    names: dict[str, Any] = {name: _class_of(message) for name, message in descriptor.message_types_by_name.items()}
    for name, enum in descriptor.enum_types_by_name.items():
        names |= {name: Enum(enum), **{value.name: value.number for value in enum.values}}
    return names


def _loaded() -> dict[str, dict[str, Any]]:
    files = descriptor_pb2.FileDescriptorSet.FromString(FILES).file  # each after those that it imports
    for file in files:
        _POOL.AddSerializedFile(file.SerializeToString())
    return {file.name: _names_in(_POOL.FindFileByName(file.name)) for file in files}


_NAMES = _loaded()


def names_of(file: str) -> dict[str, Any]:
    """The messages, enums and values of enums of a .proto file, by their names."""
    return _NAMES[file]
