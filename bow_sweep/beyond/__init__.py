"""Claims that the field has made since the paper, compared with the results of this program.

claim             a claim, what is found, and the verdict
claims_linear     identities, linear theory, steady sliding
formulas          limits and frequencies in closed form
measures          limits of rows, beats, edges of maps
cells             cells computed here, with slips and verdicts
drawing           the figures
"""
