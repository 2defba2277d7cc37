#!/usr/bin/env bash
# service.sh BUILD_DIR [SECONDS [load [thorough]|streams]]: measures the service beside bare gRPC in the same run and prints one Markdown
# table. Wants an idle machine; builds nothing (targets voxelpiped, voxelpipe, service_yardstick, service_client). With "load" or "streams"
# only the rows of service_load.py or service_streams.py; with "load thorough" and a minute at ten times the load.
set -euo pipefail
build=$1
seconds=${2:-3}
echo "Machine: $(nproc) cores, $(sed -n 's/^model name.*: //p' /proc/cpuinfo | head -1); load $(cut -d' ' -f1-3 /proc/loadavg); commit $(git describe --always --dirty 2>/dev/null || echo unknown); $seconds s a row"
echo
exec bash "$(dirname "$0")/../support/python.sh" "$(dirname "$0")/service.py" "$build/bin" "$seconds" "${@:3}"
