#!/bin/sh
# A run's tasks by an array of Slurm jobs, which are all alike: each does whatever can be done, until nothing is left.
#
#     asra-stream plan tiles/ -o city.ply --work /shared/city --processes 8
#     sbatch slurm.sh /shared/city
#
# Jobs that start late, or never, change nothing but the time that it takes. Options of sbatch go before the file's name, as in `sbatch --array=0-63 --mem=32G slurm.sh /shared/city`.
# With another --time, set FOR to what is left of it after the longest task (`sbatch --export=ALL,FOR=40m --time=1:00:00 ...`): a job begins no task later.
# PROGRAM names the program, if it is not found as asra-stream. docs/clusters.md tells more.
#
#SBATCH --job-name=asra-stream
#SBATCH --array=0-7
#SBATCH --cpus-per-task=8
#SBATCH --mem=16G
#SBATCH --time=4:00:00
#SBATCH --requeue
#SBATCH --signal=TERM@60
#SBATCH --open-mode=append

folder=${1:?usage: sbatch slurm.sh FOLDER, which asra-stream plan --work has made}

# Three quarters of what the job may have: the system's cache of files counts, too.
memory=$((${SLURM_MEM_PER_NODE:-$((${SLURM_MEM_PER_CPU:-2048} * ${SLURM_CPUS_PER_TASK:-1}))} * 3 / 4))

# Since Slurm 22.05 a step does not know of itself how many processors its tasks have.
srun --cpus-per-task="${SLURM_CPUS_PER_TASK:-1}" "${PROGRAM:-asra-stream}" work "$folder" --any \
    --shard "$((SLURM_ARRAY_TASK_ID - SLURM_ARRAY_TASK_MIN))/$((SLURM_ARRAY_TASK_MAX - SLURM_ARRAY_TASK_MIN + 1))" \
    --for "${FOR:-200m}" --max-memory "${memory}M" --threads "${SLURM_CPUS_PER_TASK:-1}"
code=$?

# Slurm itself starts a job again when its node is lost. What ended for another reason that may pass is put back into the queue here: how often at most?
case $code in
    0) exit 0 ;;
    75 | 143) tries=100 ;;               # time is up, or the disk was full: there is more to do
    69 | 74 | 129 | 137) tries=5 ;;      # not there yet; input or output failed; ended by HUP or KILL
    76) tries=3 ;;                       # a file was damaged, and is made again
    *) exit $code ;;                     # nothing that passes: options, damaged input, too little memory or disk
esac
restarts=${SLURM_RESTART_COUNT:-0}
echo "exit code $code after $restarts restarts, of $tries at most" >&2
[ "$restarts" -lt "$tries" ] || exit $code
# By both numbers: the array's own is one job's, too.
scontrol requeue "${SLURM_ARRAY_JOB_ID}_$SLURM_ARRAY_TASK_ID" || exit $code
# Slurm ends this script now.
sleep 60
