"""Studies: families of maps over further parameters, what they say together, and the search for the best.

over            values that a study gives a parameter, read from the command line
usual           values of a parameter of which only the name is said
asked           the file that says what was asked for
plan            a study: its maps, their names, its file
campaigns       the studies of config/campaigns
statistics      which differences between maps are significant
report          study.json: what the maps of a study say together
picture         measures against the parameters, and all maps
search          where a measure of playability is best
search_picture  the course of a search
"""
