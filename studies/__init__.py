"""Studies: what is measured once and written into docs/. What measures speed is in `bench`.

verdicts        how good the verdicts are (docs/verdicts.md); verdicts_page writes it
wolves          how many wolves are found, and how often a wolf is one (docs/verdicts.md)
labels          cells to be labelled by eye, for the study of verdicts
calibration     how what the paper leaves open changes its maps (docs/calibration.md)
terrain         terrain and playability of the six maps of Fig 11 (docs/terrain.md); terrain_maps computes them
chaos           exponents and edges of the paper's strings (docs/chaos.md)
adaptive        how little of a map must be simulated (docs/adaptive.md)
measured        how well bridge force alone is judged (docs/desk.md)
validation      a real `bow validate` as a page (docs/validation.md)

Each is run as ``python -m studies.NAME``.
"""
