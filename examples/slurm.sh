#!/bin/bash
# A sweep on several nodes of a Slurm cluster:  sbatch --nodes=4 slurm.sh fig11d --nx 512 --ny 256
# What follows the file's name goes to `bow sweep`. The first node has the coordinator and a station, each other node a
# station of its own. Directory and program can be given:  RUN=/scratch/me/run BOW=/opt/bow/bin/bow sbatch ...
# A run that has begun goes on, with its own settings: by itself where Slurm queues the job again; after the time limit
# by  RUN=run-JOB sbatch --nodes=4 slurm.sh
#SBATCH --job-name=bow
#SBATCH --ntasks-per-node=1
#SBATCH --exclusive
#SBATCH --no-kill
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
name=job$SLURM_JOB_ID${SLURM_RESTART_COUNT:+_again_$SLURM_RESTART_COUNT}  # each job has bags of its own

collect() {  # of a LOCAL that only its node sees: `bow collect RUN NODE:LOCAL/RUN_ID` before the job ends
    for part in "$local"/*/; do
        if [ -d "$part/bag" ]; then "$bow" collect "$run" "$part" || true; fi  # it says why not
    done
}

words=("$@" --out "$run")
if [ -s "$run/ledger.jsonl" ]; then
    collect
    words=(--resume "$run" "${trust[@]}")
fi
if [ ${#others[@]} -eq 0 ]; then
    exec "$bow" sweep "${words[@]}"
fi
"$bow" sweep "${words[@]}" --network "$(IFS=,; echo "${others[*]}")" &
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
srun --nodes="${#others[@]}" --ntasks="${#others[@]}" --exclude="$first" --kill-on-bad-exit=0 --no-kill \
    bash -c '"$0" station "$1_node_$((SLURM_PROCID + 1))" --run "$2" --network "$3" --out "$4" "${@:5}"' \
    "$bow" "$name" "$run" "$first" "$local" "${trust[@]}" &
stations=$!

status=0
wait $sweep || status=$?
wait $stations || echo "slurm.sh: a station ended with an error; $run has what it had finished" >&2
collect
exit $status
