"""Waveforms in, verdicts out: the automatic recognition of section III.B of Schumacher & Woodhouse (1995)."""
