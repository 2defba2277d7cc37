#!/usr/bin/env python3
"""usage: check_completion.py VOXELPIPE

Loads the completion script of each shell into that shell and checks what it proposes; a shell that is not installed is
skipped. Every option of `--help` has to be in every script.
"""
import os
import re
import shlex
import shutil
import subprocess
import sys
import tempfile
import unittest

PROGRAM = os.path.abspath(sys.argv.pop(1))
SHELLS = ("bash", "zsh", "fish")


def run(*command, **more):
    return subprocess.run(command, stdin=subprocess.DEVNULL, capture_output=True, text=True, timeout=120, **more)


def voxelpipe(*arguments):
    done = run(PROGRAM, *arguments)
    assert done.returncode == 0, done.stderr
    return done.stdout


def commands():
    return re.findall(r"^  ([a-z-]+) +[A-Z]", voxelpipe("--help").split("Subcommands:")[1], re.M)


def options(command):
    return set(re.findall(r"^  (?:-[a-zA-Z],)?(--[a-z0-9-]+)", voxelpipe(command, "--help"), re.M))


class Shell:
    """Completes command lines in a folder with the files a.glb, b c.glb and the folder d."""

    def __init__(self, shell):
        self.shell = shell
        self.folder = tempfile.TemporaryDirectory()
        for name in ("a.glb", "b c.glb"):
            open(os.path.join(self.folder.name, name), "w", encoding="utf-8").close()
        os.mkdir(os.path.join(self.folder.name, "d"))
        self.script = os.path.join(self.folder.name, "script")
        with open(self.script, "w", encoding="utf-8") as file:
            file.write(voxelpipe("completion", shell))

    def complete(self, line):
        """The proposals at the end of `line`, sorted."""
        done = getattr(self, "ask_" + self.shell)(line)
        assert done.returncode == 0, done.stdout + done.stderr
        assert not done.stderr, done.stderr
        # What stands behind a tab is a description; the script itself lies in the folder, too.
        found = {proposal.split("\t")[0].rstrip("/ ") for proposal in done.stdout.splitlines()}
        return sorted(found - {"", "script"})

    def run(self, *command):
        environment = dict(os.environ, HOME=self.folder.name, TERM="dumb", LC_ALL="C.UTF-8",
                           XDG_CONFIG_HOME=self.folder.name + "/.config", XDG_DATA_HOME=self.folder.name + "/.data")
        return run(*command, cwd=self.folder.name, env=environment)

    def ask_bash(self, line):
        words = line.replace("=", " = ").split(" ")
        return self.run("bash", "--norc", "-c", f"""
            source ./script
            COMP_WORDS=({" ".join(shlex.quote(word) for word in words)})
            COMP_CWORD={len(words) - 1}
            _voxelpipe
            ((${{#COMPREPLY[@]}})) && printf '%s\\n' "${{COMPREPLY[@]}}"
            exit 0""")

    def ask_fish(self, line):
        return self.run("fish", "--no-config", "-c", f"source ./script; complete -C {shlex.quote(line)}")

    def ask_zsh(self, line):
        # zsh completes in its line editor only: one in a pseudo terminal. A stand-in for compadd prints the
        # proposals; with -O, -A or -D compadd sorts words out for its caller, and proposes nothing.
        return self.run("zsh", "-f", "-c", f"""
            zmodload zsh/zpty
            zpty shell zsh -f -i
            zpty -w shell 'PS1= PS2= RPS1= ; autoload -U compinit; compinit -u -D'
            zpty -w shell 'source ./script'
            zpty -w shell 'compadd () {{
              if [[ ${{argv[(I)-[OAD]]}} -eq 0 ]]; then
                local -a own; builtin compadd -O own "$@"
                for word in $own; do print -r -- "<<$word>>" >>proposals; done
              fi
              builtin compadd "$@"
            }}'
            zpty -w shell 'bindkey "^I" complete-word; finish () {{ print -r done >finished }}; zle -N finish
              bindkey "^X" finish'
            zpty -w shell 'zle_ready () {{ print -r ready >ready }}; zle -N zle-line-init zle_ready'
            for ((i = 0; i < 600; ++i)); do [[ -e ready ]] && break; sleep 0.05; zpty -r -t shell unused; done
            zpty -n -w shell {shlex.quote(line)}$'\\t'$'\\x18'
            for ((i = 0; i < 600; ++i)); do [[ -e finished ]] && break; sleep 0.05; zpty -r -t shell unused; done
            [[ -e finished ]] || {{ print -u2 "no answer"; exit 1 }}
            zpty -d shell
            [[ -e proposals ]] && sed -n 's/^<<\\(.*\\)>>$/\\1/p' proposals | grep -v '^script$\\|^proposals$\\|^ready$'
            rm -f proposals ready finished
            exit 0""")

    def close(self):
        self.folder.cleanup()


class Scripts(unittest.TestCase):
    def test_every_command_and_option_is_in_every_script(self):
        for shell in SHELLS:
            script = voxelpipe("completion", shell)
            for command in commands():
                self.assertRegex(script, rf"\b{command}\b")
                for option in options(command):
                    name = "-l " + option[2:] if shell == "fish" else option
                    self.assertIn(name, script, f"{shell}: {command}")

    def test_an_unknown_shell_is_refused_with_one_line(self):
        done = run(PROGRAM, "completion", "tcsh")
        self.assertEqual(done.returncode, 2)
        self.assertEqual(done.stderr.count("\n"), 1)

    def check(self, shell):
        if not shutil.which(shell):
            self.skipTest(f"{shell} is not installed")
        asked = Shell(shell)
        try:
            self.assertEqual(asked.complete("voxelpipe "), sorted(commands()))
            self.assertEqual(asked.complete("voxelpipe vox"), ["voxelize"])
            self.assertEqual(asked.complete("voxelpipe voxelize --fit "), ["cube", "tight"])
            self.assertEqual(asked.complete("voxelpipe voxelize --fill n"), ["none", "nonzero"])
            self.assertEqual(asked.complete("voxelpipe voxelize --cov"), ["--coverage"])
            self.assertEqual(asked.complete("voxelpipe voxelize --shader occ"), ["occupancy"])
            self.assertIn("transform", asked.complete("voxelpipe voxelize --vertex-shader tr"))
            self.assertEqual(asked.complete("voxelpipe completion "), ["bash", "fish", "zsh"])
            files = [name.replace("\\", "") for name in asked.complete("voxelpipe info ")]
            self.assertEqual(files, ["a.glb", "b c.glb", "d"])
            self.assertEqual(asked.complete("voxelpipe voxelize a.glb -o a"), ["a.glb"])
            self.assertEqual(asked.complete("voxelpipe batch --output-dir "), ["d"])
            self.assertEqual(asked.complete("voxelpipe voxelize --resolution "), [])
            if shell == "bash":
                self.assertEqual(asked.complete("voxelpipe voxelize --fit="), ["cube", "tight"])
        finally:
            asked.close()

    def test_bash(self):
        self.check("bash")

    def test_zsh(self):
        self.check("zsh")

    def test_fish(self):
        self.check("fish")


if __name__ == "__main__":
    unittest.main(verbosity=2)
