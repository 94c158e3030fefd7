"""The command `bow`, one module for each of its commands.

parser        the parser of all commands, and what runs one
sweep         `bow sweep`
sweep_jobs    the runs that `bow sweep` is to make
sweep_report  what `bow sweep` prints of a run that is finished
study         `bow study`
study_report  what `bow study` writes and prints of a study that is finished
optimise      `bow optimise`
map_runs      several maps run one after the other
inspect       `bow inspect`
transient     `bow transient`
edges         `bow edges`
exponent      `bow exponent`
verify        `bow verify`
replay        `bow replay`
recover       `bow recover`
collect       `bow collect`
figure        `bow figure`
validate      `bow validate`
validate_beyond  its second page, `bow validate --beyond`
compare       `bow compare`
explore       `bow explore`
repeats       `bow repeats`
export        `bow export`
plot          `bow plot`
classify      `bow classify`
settings      `bow settings`
up            `bow up`, `bow down`: a graph that stays
station       `bow station`
status        `bow status`
nodes         `bow coordinator`, `bow simulator` and so on
terminal      messages to the user
"""

from collections.abc import Sequence


def main(arguments: Sequence[str] | None = None) -> int:
    """Run the command `bow` with `arguments` (those of the process unless given); return its exit status."""
    from bow_sweep.cli.parser import main as run

    return run(arguments)
