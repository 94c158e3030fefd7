"""The command `bow`, a module a group of commands.

main      the parser of the whole, and the short commands
sweep     `bow sweep`
paper     `bow figure`, `bow validate`
compare   `bow compare`
"""
