"""A real string: its bridge force, from a sensor, as the classifier takes it. No ROS.

force_slips  the slips of a string, from its bridge force alone
pitch        the period of a sound, near one that is expected
tuning       what a recording must tell before it can be judged: pitch, bow position, polarity
pieces       blocks of samples in, as they come; chunks of force and slips out
samples      the samples in the messages that sensors publish
listening    when judging begins and ends: silence, gaps, samples that are no numbers
session      the run of a measured string: its plan, its stream messages, what is answered
"""
