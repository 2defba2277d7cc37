#!/usr/bin/env python3
"""usage: check_manual.py VOXELPIPE

The manual page is valid where man and mandoc can tell, and has every command and option of `--help`.
"""
import os
import re
import shutil
import subprocess
import sys
import tempfile
import unittest

PROGRAM = os.path.abspath(sys.argv.pop(1))


def run(*command):
    environment = dict(os.environ, LC_ALL="C.UTF-8", MANWIDTH="100", MANROFFSEQ="", MAN_KEEP_FORMATTING="")
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, env=environment,
                          timeout=120)


class Manual(unittest.TestCase):
    def setUp(self):
        self.folder = tempfile.TemporaryDirectory()
        self.addCleanup(self.folder.cleanup)
        self.page = os.path.join(self.folder.name, "voxelpipe.1")
        with open(self.page, "w", encoding="utf-8") as file:
            file.write(run(PROGRAM, "manual").stdout)

    def test_man_has_no_warnings_and_shows_every_option(self):
        if not shutil.which("man") or not shutil.which("groff"):
            self.skipTest("man or groff is not installed")
        done = run("man", "--warnings", "-l", self.page)
        self.assertEqual((done.returncode, done.stderr), (0, ""))
        text = re.sub(r".\x08", "", done.stdout).replace("\u2010", "-")
        for command in re.findall(r"^  ([a-z-]+) +[A-Z]", run(PROGRAM, "--help").stdout.split("Subcommands:")[1], re.M):
            section = re.search(rf"^   {command}\n(.*?)(?=^   \S|^\S)", text, re.M | re.S)
            self.assertIsNotNone(section, command)
            for option in re.findall(r"^  (?:-[a-zA-Z],)?(--[a-z0-9-]+)", run(PROGRAM, command, "--help").stdout, re.M):
                self.assertRegex(section[1], rf"{option}(?![a-z-])", command)

    def test_mandoc_finds_no_error(self):
        if not shutil.which("mandoc"):
            self.skipTest("mandoc is not installed")
        done = run("mandoc", "-T", "lint", "-W", "warning", self.page)
        # Pages of reproducible builds have no date.
        lines = [line for line in done.stdout.splitlines() if "missing date" not in line]
        self.assertEqual(lines, [])


if __name__ == "__main__":
    unittest.main(verbosity=2)
