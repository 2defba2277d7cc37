"""The parts of a mesh, as a result tells them."""
from __future__ import annotations

import dataclasses
import operator
import re
from typing import Any, Iterator, SupportsIndex, overload

import numpy
import numpy.typing

Array = numpy.typing.NDArray[Any]

_SHOWN = 12  # rows of a repr


@dataclasses.dataclass(frozen=True, slots=True)
class Part:
    """One part: a set of triangles that bounds a solid of its own. Fields: those of Parts, of this part.

    number: from 0, by the part's first triangle. name: "" where the file gives none. open_edges, odd_columns, voxels:
    None without a fill.
    """

    number: int
    name: str
    label: int
    priority: int
    triangles: int
    open_edges: int | None
    odd_columns: int | None
    voxels: int | None


@dataclasses.dataclass(frozen=True, slots=True, eq=False, repr=False)
class Parts:
    """The parts of a mesh by their numbers: a column an array, with an element a part.

    `parts[2]` is a Part, `parts[1:3]` a list of them, `parts["wing"]` the one of that name; `for part in parts` gives
    all, `"wing" in parts` tells if there is one.

    label: uint32, what the shader `label` gives. priority: int32; where parts overlap, the highest owns the voxel, of
    equal ones the part of the highest number. triangles: int64. name: texts; several parts may have the same.

    Of a request with fill "parity" or "nonzero", else None, all int64: open_edges: edges that an odd number of the
    part's triangles use; a closed part has none. odd_columns: rows of voxels along x in which the part's crossings do
    not close, because it is open there. voxels: those that the part owns: one of its triangles covers them or their
    centre is inside of it, and no part of a higher rank has them. With coverage "none" they are the part's volume.

    Two tables are equal if all of their bytes are. They can be pickled.
    """

    label: Array
    priority: Array
    triangles: Array
    open_edges: Array | None
    odd_columns: Array | None
    voxels: Array | None
    name: list[str]
    _name_offset: Array  # int64 (n + 1): name i is UTF-8 in the bytes [_name_offset[i], _name_offset[i + 1])
    _name_bytes: Array

    def __len__(self) -> int:
        return len(self.label)

    @overload
    def __getitem__(self, key: SupportsIndex | str) -> Part:
        ...

    @overload
    def __getitem__(self, key: slice) -> list[Part]:
        ...

    def __getitem__(self, key: SupportsIndex | slice | str) -> Part | list[Part]:
        """A part by its number or its name. Errors: IndexError; KeyError if no part has that name, or several have."""
        if isinstance(key, slice):
            return [self._part(number) for number in range(*key.indices(len(self)))]
        if not isinstance(key, str):
            number = operator.index(key)
            if not -len(self) <= number < len(self):
                raise IndexError(f"there is no part {number}; there are {len(self)}")
            return self._part(number % len(self))
        count = self.name.count(key)
        if count != 1:
            names = ", ".join(map(repr, list(dict.fromkeys(self.name))[:_SHOWN]))
            raise KeyError(f"{count} parts are called {key!r}; see named()" if count else f"{key!r}; there are {names}")
        return self._part(self.name.index(key))

    def __contains__(self, item: object) -> bool:
        """True if there is a part of this name, or this Part."""
        return item in self.name if isinstance(item, str) else any(item == part for part in self)

    def __iter__(self) -> Iterator[Part]:
        return map(self._part, range(len(self)))

    def named(self, pattern: str) -> list[Part]:
        """The parts whose name matches, as in a request: `*` is any text, `?` one character, all else itself."""
        escaped = re.escape(pattern).replace(r"\*", ".*").replace(r"\?", ".")
        whole = re.compile(escaped, re.DOTALL)
        return [self._part(number) for number, name in enumerate(self.name) if whole.fullmatch(name)]

    @property
    def nbytes(self) -> int:
        """Memory of all arrays, in bytes."""
        return sum(array.nbytes for array in self._arrays.values())

    @property
    def _arrays(self) -> dict[str, Array]:
        """By their names in a result, in stream order. 64-bit numbers are below 2^63, so int64 has the bytes of u64."""
        counted = {"open_edges": self.open_edges, "odd_columns": self.odd_columns, "voxels": self.voxels}
        arrays = {"label": self.label, "priority": self.priority, "triangles": self.triangles}
        arrays |= {name: array for name, array in counted.items() if array is not None}
        arrays |= {"name_offset": self._name_offset, "name": self._name_bytes}
        return {f"part_{name}": array for name, array in arrays.items()}

    @property
    def _columns(self) -> dict[str, list[int] | list[str]]:
        """The table as the command line's --json has it."""
        columns: dict[str, list[int] | list[str]] = {
            name.removeprefix("part_"): array.tolist() for name, array in self._arrays.items()
        }
        del columns["name_offset"]
        return columns | {"name": self.name}

    def _part(self, number: int) -> Part:
        def counted(array: Array | None) -> int | None:
            return None if array is None else int(array[number])

        return Part(
            number=number,
            name=self.name[number],
            label=int(self.label[number]),
            priority=int(self.priority[number]),
            triangles=int(self.triangles[number]),
            open_edges=counted(self.open_edges),
            odd_columns=counted(self.odd_columns),
            voxels=counted(self.voxels),
        )

    def __eq__(self, other: object) -> bool:
        if not isinstance(other, Parts):
            return NotImplemented
        mine, others = self._arrays, other._arrays
        return list(mine) == list(others) and all(numpy.array_equal(mine[name], others[name]) for name in mine)

    __hash__ = None  # type: ignore[assignment]

    def __repr__(self) -> str:
        rows = [("", "label", "priority", "triangles", *(("open edges", "voxels") if self.voxels is not None else ()))]
        for part in self[:_SHOWN]:
            numbers = [part.label, part.priority, part.triangles, part.open_edges, part.voxels][: len(rows[0]) - 1]
            rows.append((repr(part.name), *map(str, numbers)))
        wide = [max(map(len, column)) for column in zip(*rows)]
        lines = ["  ".join([row[0].ljust(wide[0]), *map(str.rjust, row[1:], wide[1:])]) for row in rows]
        more = [f"and {len(self) - _SHOWN} more"] if len(self) > _SHOWN else []
        return "\n  ".join([f"<Parts: {len(self)}", *lines, *more]) + ">"
