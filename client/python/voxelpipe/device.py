"""Results that stay in a GPU's memory, for CuPy, PyTorch, JAX and Numba."""
from __future__ import annotations

import dataclasses
from typing import Any, Mapping

import numpy

from .part_table import Parts
from .place import GridPlace
from .report import MeshWarning, Summary
from .targets import Target

_CUDA = 2  # kDLCUDA
_CODES = {"u": 1, "f": 2}  # kDLUInt, kDLFloat


class DeviceArray:
    """A C-contiguous array in a GPU's memory. It lives as long as this object and all that was made of it.

    `torch.from_dlpack(a)`, `cupy.from_dlpack(a)` and `cupy.asarray(a)` share its memory. All work on it is done when it
    is handed out, so that consumers need not wait for a stream; before the last owner goes, their own must be done.
    """

    def __init__(self, buffer: Any, shape: tuple[int, ...], dtype: numpy.dtype[Any]) -> None:
        self._buffer = buffer
        self.shape = shape
        self.dtype = dtype

    @property
    def nbytes(self) -> int:
        """Bytes on the device."""
        return int(self._buffer.size)

    @property
    def __cuda_array_interface__(self) -> dict[str, Any]:
        return {
            "shape": self.shape,
            "typestr": self.dtype.str,
            "data": (self._buffer.pointer, False),
            "strides": None,
            "stream": None,
            "version": 3,
        }

    def __dlpack__(
        self,
        *,
        stream: Any = None,
        max_version: tuple[int, int] | None = None,
        dl_device: tuple[Any, int] | None = None,
        copy: bool | None = None,
    ) -> Any:
        """An unversioned capsule, which consumers of every version take. Errors: BufferError for another device, or a
        copy, which the consumer makes.
        """
        if copy or dl_device not in (None, self.__dlpack_device__()):
            raise BufferError("the array stays where it is; copy what was made of it")
        return self._buffer.dlpack(_CODES[self.dtype.kind], 8 * self.dtype.itemsize, list(self.shape))

    def __dlpack_device__(self) -> tuple[int, int]:
        return _CUDA, int(self._buffer.ordinal)

    def __repr__(self) -> str:
        return f"<voxelpipe.DeviceArray {self.shape} {self.dtype} on cuda:{self._buffer.ordinal}>"


@dataclasses.dataclass(frozen=True)
class DeviceGrid:
    """A dense result on a GPU. arrays: a DeviceArray of (nz, ny, nx[, c]) for each target's name; of bits, the flat
    packed bytes, bit n % 8 of byte n / 8. parts: see VoxelGrid.parts; in this machine's memory.
    """

    place: GridPlace
    targets: tuple[Target, ...]
    arrays: Mapping[str, DeviceArray]
    warnings: tuple[MeshWarning, ...]
    summary: Summary
    parts: Parts | None = None

    def __getitem__(self, name: str) -> DeviceArray:
        if name not in self.arrays:
            raise KeyError(f"{name!r}; the targets are {', '.join(self.arrays)}")
        return self.arrays[name]
