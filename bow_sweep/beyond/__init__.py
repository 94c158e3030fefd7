"""Claims that the field has made since the paper, compared with the results of this program.

claim             a claim, what is found, and the verdict
claims_linear     identities, linear theory, steady sliding
claims_wolf       the wolf, and a mode near the note
claims_guettler   Guettler's plane
claims_schelleng  limits of force, and note by note
claims_thermal    thermal friction under a bowed string
claims_chaos      repeats, edges and exponents
sweeps            the runs that claims are about
formulas          limits and frequencies in closed form
measures          limits of rows, beats, edges of maps
cells             cells computed here, with slips and verdicts
drawing           the figures
report            table and page
"""
