#!/usr/bin/env bash
# Adds to the folder TREE this machine's files of Debian packages and of those that they depend on, and no others.
# usage: clean_tree.sh TREE PACKAGE...
set -euo pipefail
tree="$1"
shift
mkdir -p "$tree"/{dev,proc,sys,tmp,root}
for folder in bin sbin lib lib64; do
  if [[ -L "/$folder" && ! -e "$tree/$folder" ]]; then mkdir -p "$tree/usr/$folder" && cp -P "/$folder" "$tree/"; fi
done
apt-cache depends --installed --recurse --no-recommends --no-suggests --no-conflicts --no-breaks --no-replaces \
  --no-enhances "$@" | grep '^[a-z0-9]' | xargs dpkg-query -L 2>/dev/null | sort -u >"$tree/files"
# What chooses between packages' files: libblas.so.3.
find /usr/bin /usr/lib/*-linux-gnu -maxdepth 1 -lname '/etc/alternatives/*' >>"$tree/files"
find /etc/alternatives >>"$tree/files"
# A package may list files that were left out or removed.
{ xargs -d '\n' ls -d <"$tree/files" 2>/dev/null || true; } |
  tar -C / -c --no-recursion -T - 2>/dev/null | tar -C "$tree" -x --keep-directory-symlink
rm "$tree/files"
ldconfig -r "$tree"
