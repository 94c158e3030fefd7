"""From features to a verdict: the regime of a cell, and the confidence in it.

regimes      the regimes: code, name, definition, source
thresholds   the thresholds, which a sweep can set
decision     from features to a regime
confidence   the probability that the regime is right
fingerprint  the hash of the sources that decide a verdict
"""
