# Read before every shell block of the documentation: it ends at the first command that fails, and its sweeps are small.
set -euo pipefail

bow() {
  if [[ ${1-} == sweep && $* != *--nx* && $* != *--resume* ]]; then
    command bow "$@" --nx 16 --ny 8 --periods 30
  else
    command bow "$@"
  fi
}
