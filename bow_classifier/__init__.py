"""Waveforms in, verdicts out: the automatic recognition of section III.B of Schumacher & Woodhouse (1995).

features           what is measured on a waveform
verdict            regimes, thresholds, and the decision between regimes
chunk_pass         all features and the decision for the cells of a block, in one compiled pass
block_classifier   the chunks of one block, one after another
task               what the classifier needs to know of a sweep
stream             stream messages in, verdict messages out, for all blocks of a sweep
precompile         compiles the pass and caches the code
node               the classifier node
"""
