"""What the features together say: the regime, and how sure that is.

regimes      the regimes: code, name, definition, source
thresholds   the thresholds that decide
decision     from features to a regime
confidence   the probability that the regime is named rightly
fingerprint  the hash of the sources that decide a verdict
"""
