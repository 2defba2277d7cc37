"""CRC-32C (Castagnoli) of a buffer: by the library ISA-L if this machine (Debian: libisal2) or the wheel voxelpipe-core
has it, by the package crc32c or google-crc32c if one is installed, else by numpy.

Sources of the numpy form: M. Adler, crc32_combine of zlib (the CRC of joined blocks by a linear map a block);
M. Kounavis, F. Berry 2008, "Novel Table Lookup-Based Algorithms for High-Performance CRC Generation" (slicing).
Changed: slices of 16 bits, and thousands of blocks side by side.
"""
from __future__ import annotations

import ctypes
import functools
from typing import Any, Callable

import numpy
import numpy.typing

from .core_files import core_files

_POLYNOMIAL = 0x82F63B78  # reflected
_LANES = 8192  # blocks of a buffer that run side by side
_SMALL_BYTES = 1 << 14

_Words = numpy.typing.NDArray[numpy.uint32]


@functools.cache
def _byte_table() -> _Words:
    """The state after one byte, from the state 0."""
    table = numpy.arange(256, dtype=numpy.uint32)
    for _ in range(8):
        table = (table >> 1) ^ numpy.where(table & 1, numpy.uint32(_POLYNOMIAL), numpy.uint32(0))
    return table


@functools.cache
def _word_tables() -> tuple[_Words, _Words]:
    """The state after four bytes, of which the first two, or the last two, are the index and the others 0."""
    table = _byte_table()
    after = numpy.arange(65536, dtype=numpy.uint32)
    for _ in range(2):
        after = table[after & 0xFF] ^ (after >> 8)
    first = after
    for _ in range(2):
        first = table[first & 0xFF] ^ (first >> 8)
    return first, after


def _apply(map_tables: _Words, crc: _Words) -> _Words:
    """A linear map of 32 bits, as four tables of 256, on each of an array."""
    result: _Words = (
        map_tables[0][crc & 0xFF]
        ^ map_tables[1][(crc >> 8) & 0xFF]
        ^ map_tables[2][(crc >> 16) & 0xFF]
        ^ map_tables[3][crc >> 24]
    )
    return result


@functools.lru_cache(maxsize=256)
def _zeros(count: int) -> _Words:
    """The map of the state over `count` zero bytes, as four tables of 256."""
    each_byte = numpy.arange(256, dtype=numpy.uint32)
    if count == 0:
        return numpy.stack([each_byte << (8 * k) for k in range(4)])
    if count % 2:
        step = _zeros(count - 1)
        result: _Words = _byte_table()[step & 0xFF] ^ (step >> 8)
        return result
    half = _zeros(count // 2)
    return numpy.stack([_apply(half, half[k]) for k in range(4)])


def crc32c_numpy(data: Any) -> int:
    """The CRC-32C of a buffer, without another package: some hundred megabytes a second."""
    data_bytes = numpy.frombuffer(data, numpy.uint8)
    words = len(data_bytes) // (4 * _LANES)
    state = 0xFFFFFFFF
    if words:
        lanes = numpy.ascontiguousarray(data_bytes[: words * 4 * _LANES].view("<u4").reshape(_LANES, words).T)
        first, last = _word_tables()
        crc = numpy.zeros(_LANES, numpy.uint32)
        crc[0] = state
        for word in lanes:
            crc ^= word
            crc = first.take(crc & 0xFFFF) ^ last.take(crc >> 16)
        block = words * 4
        while len(crc) > 1:
            crc = _apply(_zeros(block), crc[0::2]) ^ crc[1::2]
            block *= 2
        state = int(crc[0])
    rest = data_bytes[words * 4 * _LANES :].tolist()
    plain = _byte_table().tolist() if rest else []
    for byte in rest:
        state = plain[(state ^ byte) & 0xFF] ^ (state >> 8)
    return state ^ 0xFFFFFFFF


def _of_isal() -> Callable[[Any], int] | None:
    """crc32_iscsi of Intel's ISA-L (crc.h): at memory speed, without the interpreter's lock."""
    for library in ["libisal.so.2", *map(str, core_files("libs/libisal-*.so.2"))]:
        try:
            function = ctypes.CDLL(library).crc32_iscsi
            quick = ctypes.PyDLL(library).crc32_iscsi  # keeps the lock: to get it back costs more than few bytes
            break
        except (OSError, AttributeError):
            pass
    else:
        return None
    for each in (function, quick):
        each.argtypes = [ctypes.c_void_p, ctypes.c_int, ctypes.c_uint]
        each.restype = ctypes.c_uint
    most = 1 << 30  # its length is an int

    def crc32c(data: Any) -> int:
        if len(data) <= _SMALL_BYTES:  # a copy is cheaper than numpy's addresses
            return int(quick(bytes(data), len(data), 0xFFFFFFFF)) ^ 0xFFFFFFFF
        data_bytes = numpy.frombuffer(data, numpy.uint8)
        state = 0xFFFFFFFF
        for at in range(0, len(data_bytes), most):
            part = data_bytes[at : at + most]
            state = function(part.ctypes.data, len(part), state)
        return state ^ 0xFFFFFFFF

    return crc32c


def _chosen() -> Callable[[Any], int]:
    isal = _of_isal()
    if isal is not None and isal(b"123456789") == 0xE3069283:
        return isal
    try:
        import crc32c as native
    except ImportError:
        pass
    else:
        return lambda data: int(native.crc32c(data))
    try:
        import google_crc32c
    except ImportError:
        return crc32c_numpy
    return lambda data: int(google_crc32c.value(bytes(data)))


crc32c: Callable[[Any], int] = _chosen()
