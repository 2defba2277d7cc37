#!/usr/bin/env bash
# Submits the array job of a list, and the job after it that sums up. Prints the number of the array job.
#   submit.sh [OPTION of sbatch...] -- LIST OUTPUT_DIR [OPTION of voxelpipe batch...]
#   submit.sh --array=0-7 --cpus-per-task=8 -- list.jsonl results --resolution 128
# Submitted again, with the same or another --array, it does what is missing.
set -euo pipefail

here=$(cd "$(dirname "${BASH_SOURCE[0]}")" && pwd)
options=()
while [[ $# -gt 0 && $1 != -- ]]; do
  options+=("$1")
  shift
done
[[ $# -ge 3 ]] || { sed -n '3,4s/^#   /usage: /p' "${BASH_SOURCE[0]}" >&2; exit 2; }
shift
job=$(sbatch --parsable "${options[@]}" "$here/batch.sbatch" "$@")
job=${job%%;*}
sbatch --dependency="afterany:$job" "$here/aggregate.sbatch" "$2" "$job" >&2
echo "$job"
