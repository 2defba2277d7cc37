#!/usr/bin/env python3
"""usage: scripts_test.py COMPILER

Tests check_skips.py, check_includes.py and commit_line.sh on small examples.
"""
import json
import pathlib
import subprocess
import sys
import tempfile
import unittest

HERE = pathlib.Path(__file__).resolve().parent
COMPILER = "c++"

RESULTS = """<testsuite name="voxelpipe" tests="3">
<testcase name="Grid.IsDense" status="run"><system-out></system-out></testcase>
<testcase name="cuda_parity" status="notrun"><skipped message="SKIP_RETURN_CODE=77"/>
<system-out>skipped: no GPU</system-out></testcase>
<testcase name="Cli.Pages" status="notrun"><skipped message="SKIP_REGULAR_EXPRESSION_MATCHED"/>
<system-out>no terminal</system-out></testcase>
</testsuite>
"""


def run(*command, cwd=None):
    return subprocess.run([str(part) for part in command], cwd=cwd, stdout=subprocess.PIPE, stderr=subprocess.STDOUT,
                          text=True)


class InFolder(unittest.TestCase):
    def setUp(self):
        folder = tempfile.TemporaryDirectory()
        self.addCleanup(folder.cleanup)
        self.folder = pathlib.Path(folder.name)

    def write(self, name, text):
        path = self.folder / name
        path.write_text(text, encoding="utf-8")
        return path


class Skips(InFolder):
    def check(self, rules):
        results = self.write("results.xml", RESULTS)
        return run(sys.executable, HERE / "check_skips.py", self.write("list", rules), results)

    def test_listed_skips_pass(self):
        done = self.check("# comment\ncuda_*  no GPU\nCli.Pages  no terminal\n")
        self.assertEqual(done.returncode, 0, done.stdout)
        self.assertIn("3 tests, 2 skipped, 0 of them unexpected", done.stdout)

    def test_a_skip_that_is_not_listed_fails_with_its_reason(self):
        done = self.check("cuda_*  no GPU\n")
        self.assertEqual(done.returncode, 1)
        self.assertIn("Cli.Pages: no terminal", done.stdout)

    def test_a_pattern_without_a_test_or_a_reason_fails(self):
        self.assertIn("no test is named 'gone_*'", self.check("*  any\ngone_*  nothing\n").stdout)
        self.assertIn("'cuda_*' has no reason", self.check("cuda_*\n").stdout)


class Includes(InFolder):
    def check(self, text):
        """In: a source that is compiled with <vector> and <string> precompiled."""
        (self.folder / "tests" / "ci").mkdir(parents=True)
        script = self.write("tests/ci/check_includes.py", (HERE / "check_includes.py").read_text(encoding="utf-8"))
        build = self.folder / "build"
        build.mkdir()
        self.write("build/cmake_pch.hxx", "#include <string>\n#include <vector>\n")
        source = self.write("a.cpp", text)
        command = f"cmake -E env A=B {COMPILER} -std=c++20 -Werror -include {build}/cmake_pch.hxx -o a.o -c {source}"
        self.assertEqual(run("sh", "-c", command[len("cmake -E env A=B "):], cwd=build).returncode, 0)
        self.write("build/compile_commands.json",
                   json.dumps([{"directory": str(build), "command": command, "file": str(source)}]))
        return run(sys.executable, script, build, COMPILER)

    def test_a_file_with_its_includes_passes(self):
        done = self.check("#include <vector>\nstd::vector<int> v;\n")
        self.assertEqual(done.returncode, 0, done.stdout)

    def test_a_file_that_relies_on_precompiled_headers_fails(self):
        done = self.check("std::vector<int> v;\n")
        self.assertEqual(done.returncode, 1)
        self.assertIn("a.cpp does not compile without precompiled headers", done.stdout)


class CommitLine(InFolder):
    def test_it_keeps_the_exit_code_and_tells_of_changes(self):
        git = ["git", "-c", "user.name=a", "-c", "user.email=a@b", "-C", self.folder]
        for command in (["init", "-q"], ["commit", "-q", "--allow-empty", "-m", "a"]):
            self.assertEqual(run(*git, *command).returncode, 0)
        done = run("bash", HERE / "commit_line.sh", "make a", "false", cwd=self.folder)
        self.assertEqual(done.returncode, 1)
        self.assertRegex(done.stdout, "^make a: commit [0-9a-f]+, clean tree\\n$")
        self.write("b", "")
        done = run("bash", HERE / "commit_line.sh", "make a", "true", cwd=self.folder)
        self.assertIn("tree with changes", done.stdout)


if __name__ == "__main__":
    COMPILER = sys.argv.pop()
    unittest.main()
