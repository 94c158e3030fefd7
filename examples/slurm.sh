#!/bin/bash
# A sweep on several nodes of a Slurm cluster:  sbatch --nodes=4 slurm.sh fig11d --nx 512 --ny 256
# What follows the file's name goes to `bow sweep`. The first node has the coordinator and a station, each other node a
# station of its own. Directory and program can be given:  RUN=/scratch/me/run BOW=/opt/bow/bin/bow sbatch ...
#SBATCH --job-name=bow
#SBATCH --ntasks-per-node=1
#SBATCH --exclusive
#SBATCH --time=01:00:00
set -euo pipefail

bow=${BOW:-bow}
run=$(realpath -m "${RUN:-run-$SLURM_JOB_ID}")  # seen by all nodes; LOCAL may be a disk of each node
local=$(realpath -m "${LOCAL:-$run.stations}")
trust=()
for word; do if [ "$word" = --i-trust-this-network ]; then trust=("$word"); fi; done
mapfile -t nodes < <(scontrol show hostnames "$SLURM_JOB_NODELIST")
first=${nodes[0]} others=("${nodes[@]:1}")
export ROS_DOMAIN_ID=${ROS_DOMAIN_ID:-$((SLURM_JOB_ID % 100))}

if [ ${#others[@]} -eq 0 ]; then
    exec "$bow" sweep "$@" --out "$run"
fi
"$bow" sweep "$@" --out "$run" --network "$(IFS=,; echo "${others[*]}")" &
sweep=$!
trap 'kill -INT $sweep 2> /dev/null || true' INT TERM

for ((second = 0; ; second++)); do  # the stations read from it which run they join
    if [ -s "$run/ledger.jsonl" ]; then break; fi
    if [ "$second" -ge 120 ] || ! kill -0 $sweep 2> /dev/null; then
        echo "slurm.sh: no $run/ledger.jsonl after $second s: the sweep did not start" >&2
        kill -INT $sweep 2> /dev/null || true
        wait $sweep || exit $?
        exit 1
    fi
    sleep 1
done
# Each station joins by itself. A node that fails takes its unfinished blocks only, so the sweep decides the job's end.
srun --nodes="${#others[@]}" --ntasks="${#others[@]}" --exclude="$first" --kill-on-bad-exit=0 \
    bash -c '"$0" station "node_$((SLURM_PROCID + 1))" --run "$1" --network "$2" --out "$3" "${@:4}"' \
    "$bow" "$run" "$first" "$local" "${trust[@]}" &
stations=$!

status=0
wait $sweep || status=$?
wait $stations || echo "slurm.sh: a station ended with an error; $run has what it had finished" >&2
for part in "$local"/*/; do  # of a LOCAL that only its node sees: `bow collect RUN NODE:LOCAL/RUN_ID` before the job ends
    if [ -d "$part/bag" ]; then "$bow" collect "$run" "$part"; fi
done
exit $status
