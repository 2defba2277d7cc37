#!/usr/bin/env python3
"""The repository keeps the rules of rooms, and rooms.py finds what does not."""
import pathlib
import sys
import tempfile
import unittest

sys.dont_write_bytecode = True
sys.path.insert(0, str(pathlib.Path(__file__).parent))
import rooms  # noqa: E402

FLOORS = ["core/low", "core/high"]


class RoomsTest(unittest.TestCase):

    def faults(self, files, **rules):
        with tempfile.TemporaryDirectory() as folder:
            top = pathlib.Path(folder)
            for name, text in files.items():
                (top / name).parent.mkdir(parents=True, exist_ok=True)
                (top / name).write_text(text)
            given = {"floors": FLOORS, "never": []}
            return rooms.find_faults(top, **{**given, **rules})

    def test_repository(self):
        self.assertEqual(rooms.find_faults(pathlib.Path(__file__).resolve().parents[2]), [])

    def test_downward(self):
        self.assertEqual(self.faults({"core/low/a.h": "", "core/high/b.cpp": '#include "low/a.h"\n'}), [])

    def test_upward(self):
        files = {"core/low/a.h": '#include "high/b.h"\n', "core/high/b.h": ""}
        self.assertEqual(self.faults(files), ["core/low/a.h: includes core/high/b.h, which stands above it"])

    def test_cycle(self):
        files = {"tests/a/a.h": '#include "b/b.h"\n', "tests/b/b.h": '#include "a/a.h"\n'}
        self.assertEqual(self.faults(files), ["a cycle of rooms: tests/a -> tests/b -> tests/a"])

    def test_never(self):
        files = {"core/low/a.h": "", "core/high/b.cpp": '#include "low/a.h"\n'}
        self.assertEqual(self.faults(files, never=[("core/high", "core/low")]),
                         ["core/high/b.cpp: includes core/low/a.h, which core/high must not"])

    def test_large_folder(self):
        files = {f"core/low/f{i}.h": "" for i in range(rooms.MAX_FILES)} | {"core/low/CMakeLists.txt": ""}
        self.assertEqual(self.faults(files), [])
        files["core/low/more.h"] = ""
        self.assertEqual(self.faults(files), [f"core/low: {rooms.MAX_FILES + 1} files, at most {rooms.MAX_FILES}"])

    def test_unknown_room(self):
        self.assertEqual(self.faults({"core/new/a.h": ""}), ["core/new: not in the list of floors in rooms.py"])


if __name__ == "__main__":
    unittest.main()
