"""The arrays of a result while their bytes arrive."""
from __future__ import annotations

import math
from typing import Any

import numpy
import numpy.typing

from ..errors import TooLarge
from ..targets import DTYPES

LIST_DTYPES: dict[str, numpy.dtype[Any]] = {
    "u64": numpy.dtype("<u8"),
    "u32": numpy.dtype("<u4"),
    "i32": numpy.dtype("<i4"),
    "u8": numpy.dtype("u1"),
}

# A server may announce what it never sends. So memory is allocated in steps: an array's size over a power of _STEP, the
# first one of at most _FIRST_BYTES. Each step copies what has arrived, a fifteenth of the array in all.
_FIRST_BYTES = 16 << 20
_STEP = 16

Array = numpy.typing.NDArray[Any]


def wire_bytes(element: str, shape: tuple[int, ...]) -> int:
    """Bytes of an array in the stream: bits are eight a byte."""
    count = math.prod(shape)
    return (count + 7) // 8 if element == "bit" else count * _dtype(element).itemsize


def memory_bytes(element: str, shape: tuple[int, ...], unpack: bool) -> int:
    """Bytes of an array in memory. unpack: bits become bools."""
    return math.prod(shape) if element == "bit" and unpack else wire_bytes(element, shape)


def _dtype(element: str) -> numpy.dtype[Any]:
    return LIST_DTYPES.get(element) or DTYPES[element]


class Destination:
    """An array that is being filled. In: its shape in elements, and whether bits become bools."""

    def __init__(self, element: str, shape: tuple[int, ...], unpack: bool) -> None:
        self.wire_bytes = wire_bytes(element, shape)
        self._memory_bytes = memory_bytes(element, shape, unpack)
        self._unpack = element == "bit" and unpack
        packed = element == "bit" and not unpack
        self._shape = (self.wire_bytes,) if packed else shape
        self._dtype = numpy.dtype(numpy.uint8) if packed else _dtype(element)
        self._bytes: Array = numpy.empty(0, numpy.uint8)  # the part that is allocated
        self._array: Array | None = None

    @property
    def array(self) -> Array:
        """The array, when all of its bytes have been written. Errors: TooLarge if there is no memory."""
        if self._array is None:
            self._allocate(self._memory_bytes, 0)
        assert self._array is not None
        return self._array

    def write(self, offset: int, data: Any) -> None:
        """Appends bytes of the stream; offset: of the first one. Errors: TooLarge if there is no memory."""
        incoming = numpy.frombuffer(data, numpy.uint8)
        times = 8 if self._unpack else 1
        first = offset * times
        end = min(first + len(incoming) * times, self._memory_bytes)
        if end > len(self._bytes):
            self._allocate(end, first)
        if self._unpack:
            incoming = numpy.unpackbits(incoming, count=end - first, bitorder="little")
        self._bytes[first:end] = incoming

    def _allocate(self, end: int, written: int) -> None:
        size = self._memory_bytes
        while size > _FIRST_BYTES and math.ceil(size / _STEP) >= end:
            size = math.ceil(size / _STEP)
        try:
            if size == self._memory_bytes:
                self._array = numpy.empty(self._shape, self._dtype)
                grown = self._array.reshape(-1).view(numpy.uint8)
            else:
                grown = numpy.empty(size, numpy.uint8)
        except (MemoryError, ValueError):  # ValueError: more than numpy can count
            raise TooLarge(f"there is no memory for an array of {self._memory_bytes} bytes") from None
        grown[:written] = self._bytes[:written]
        self._bytes = grown
