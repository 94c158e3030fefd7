"""The command `bow`, one module for each of its commands.

main          the parser of all commands
sweep         `bow sweep`
sweep_jobs    the runs that `bow sweep` is to make
sweep_report  what `bow sweep` prints of a run that is finished
transient     `bow transient`
verify        `bow verify`
replay        `bow replay`
recover       `bow recover`
figure        `bow figure`
validate      `bow validate`
compare       `bow compare`
settings      `bow settings`
nodes         `bow coordinator`, `bow simulator` and so on
terminal      messages to the user
"""
