# Read before every shell block of the documentation: it ends at the first command that fails, and its sweeps are small
# and without a dashboard. A graph that a block leaves ends with it, that of a whole page (PAGE_GRAPH) does not.
set -euo pipefail
graph() { ls "${XDG_STATE_HOME:-/nowhere}"/bow/graph-*/graph.json > /dev/null 2>&1; }
trap '[[ ${PAGE_GRAPH-} ]] || { graph && command bow down > /dev/null; }' EXIT

bow() {
  local small=()
  if [[ ${1-} == up ]] && graph; then command bow down; fi
  if [[ ${1-} == sweep && $* != *--resume* ]]; then
    small+=(--periods 30 --no-dashboard)
    [[ $* == *--nx* ]] || small+=(--nx 16 --ny 8)
  fi
  if [[ ${1-} == study || ${1-} == optimise ]] && [[ $* != *--resume* ]]; then
    small+=(--periods 20)
  fi
  command bow "$@" "${small[@]}"
}
