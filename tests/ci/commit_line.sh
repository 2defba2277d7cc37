#!/usr/bin/env bash
# usage: commit_line.sh NAME COMMAND [ARGUMENT]...
# Runs COMMAND, then prints which commit that was and whether the working tree had changes: "make test: commit 0123abc,
# clean tree". Exits as COMMAND did.
set -uo pipefail
name="$1"
shift
"$@"
code=$?
if commit="$(git rev-parse --short HEAD 2>/dev/null)"; then
  tree="clean tree"
  [[ -z "$(git status --porcelain 2>/dev/null)" ]] || tree="tree with changes"
  echo "$name: commit $commit, $tree"
else
  echo "$name: not a git checkout"
fi
exit "$code"
