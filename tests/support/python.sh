#!/usr/bin/env bash
# Runs the Python that has Debian's python3-numpy: another python3 may stand before it in PATH.
if [[ -x /usr/bin/python3 ]] && /usr/bin/python3 -c 'import numpy' 2>/dev/null; then
  exec /usr/bin/python3 "$@"
fi
exec python3 "$@"
