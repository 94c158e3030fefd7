"""The claims of the paper, compared with the results of this program.

claim           a claim and its verdict
claims_modes    section III.A: linear modes and friction
claims_motion   sections III.B and III.C: transients
claims_maps     section IV: maps
claims_terrain  sections IV.A and IV.B: terrain and models
maps            recognises the paper's maps among runs
map_measures    stripes, specks, streaks and limits of a map
validate        all claims with their verdicts
"""
