"""What the paper states, beside what this program finds.

claim           what a claim is, and what is found of it
claims_modes    section III.A: linear modes and friction
claims_motion   sections III.B and III.C: transients
claims_maps     section IV: maps
claims_terrain  sections IV.A and IV.B: terrain and models
maps            which of the paper's maps a run is
map_measures    stripes, specks, streaks, limits
validate        all claims, each with its verdict
"""
