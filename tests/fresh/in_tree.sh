#!/usr/bin/env bash
# usage: in_tree.sh TREE DIRECTORY [NAME=VALUE...] COMMAND...
#
# Runs a command in the Debian tree TREE, in its folder DIRECTORY, with these variables and no others. Root, in mount
# and process namespaces of its own (fresh_test.sh makes them): all that is mounted and started here ends with them.
# This shell stays as process 1, which has to collect the processes whose parent ended before them.
set -euo pipefail
tree="$1" directory="$2"
shift 2

mount -t proc proc "$tree/proc"
mount --rbind /sys "$tree/sys"
# Of the devices only those that every machine has, and terminals and shared memory of its own.
mount -t tmpfs -o mode=755,nosuid dev "$tree/dev"
for device in null zero full random urandom tty; do
  touch "$tree/dev/$device"
  mount --bind "/dev/$device" "$tree/dev/$device"
done
ln -s /proc/self/fd "$tree/dev/fd"
for stream in 0:stdin 1:stdout 2:stderr; do ln -s "fd/${stream%%:*}" "$tree/dev/${stream#*:}"; done
mkdir "$tree/dev/pts" "$tree/dev/shm"
mount -t devpts -o newinstance,mode=620,gid=5,ptmxmode=666 devpts "$tree/dev/pts"
ln -s pts/ptmx "$tree/dev/ptmx"
mount -t tmpfs -o mode=1777,nosuid,nodev shm "$tree/dev/shm"

# As a login of Debian 12 begins, whatever this machine raised or lowered.
umask 022
ulimit -S -c 0 -n 1024 -s 8192
# A shell lets what it runs in the background ignore SIGINT, and that is inherited.
chroot "$tree" /usr/bin/env -i --default-signal --chdir="$directory" "$@"
