"""One cell of a run: its waveform from the bag or computed again, what it shows, and how it sounds.

waveform      the motion of one cell: bridge force and slips
cell_record   what is known of one cell
parting       when the motions of repeats part from those of their cells
parameters    the parameters of the cells of a sweep
run_cells     the cells of a run: choose one, get its record
from_bag      cells out of a bag, by its index
computed      cells computed again, and whether they are the recorded ones
analysis      the steady motion of a waveform: pitch, spectrum, harmonics
motion        what happens under the bow: surface velocity and friction
sound         a bridge force as sound at 48 kHz
portrait      everything that is shown of one cell
picture       one cell as a picture in a file
body          a violin's body as a filter
"""
