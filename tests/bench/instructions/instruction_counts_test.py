"""The parts of instruction_counts.py that need no valgrind."""
import contextlib
import io
import unittest

import instruction_counts

DUMP = """version: 1
creator: callgrind-3.19.0
desc: Trigger: Client Request: avx2/bits thin

events: Ir
ob=(2) /build/bin/instruction_rows
fl=(1) ???
fn=(10) Raster
0 70
cob=(3) /lib/x86_64-linux-gnu/libc.so.6
cfn=(11) memset
calls=4 0
0 5000
+3 7
ob=(3)
fn=(11)
0 5000
cob=(4) /build/lib/libvoxelpipe_core.so.0
cfn=(12) Helper
calls=1 0
0 2
ob=(4)
fn=(12)
0 2
"""


class Test(unittest.TestCase):
    def test_only_our_own_instructions_count(self):
        self.assertEqual(instruction_counts.own_instructions(DUMP, "bin/instruction_rows"), ("avx2/bits thin", 79))

    def test_rows_beyond_the_tolerance_are_named_with_their_percentage(self):
        numbers = {"same": 1000, "more": 1000, "less": 1000, "gone": 1000}
        counted = {"same": 1029, "more": 1035, "less": 960, "added": 5}
        self.assertEqual(instruction_counts.differences(numbers, counted), [
            "added: no number in the file",
            "gone: not counted",
            "less: -4.0 % (1,000 -> 960 instructions)",
            "more: +3.5 % (1,000 -> 1,035 instructions)",
        ])

    def test_a_row_that_the_file_does_not_have_is_an_error(self):
        said = io.StringIO()
        with contextlib.redirect_stderr(said), self.assertRaises(SystemExit) as left:
            instruction_counts.main(["no_program", "no build", "--row", "no such row"])
        self.assertEqual(left.exception.code, 2)
        self.assertIn("has no row no such row", said.getvalue())


if __name__ == "__main__":
    unittest.main()
