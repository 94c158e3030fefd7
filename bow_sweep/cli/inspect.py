"""The command `bow inspect`: single cells of a run, to be seen and heard."""

from __future__ import annotations

import argparse
import time
from collections.abc import Sequence
from pathlib import Path
from typing import TYPE_CHECKING, Any

from bow_sweep.cli.terminal import fail, warn
from bow_sweep.processes.exit_status import DONE, FAILED

if TYPE_CHECKING:
    from bow_sweep.cell.cell_record import CellRecord
    from bow_sweep.cell.portrait import Portrait
    from bow_sweep.cell.run_cells import RunCells

VIEWER_WAIT_S = 3.0
"""A viewer that cannot open ends within this time."""

SOUND_HELP = "length of the sound, seconds: the string is simulated on (default: as long as the waveform)"
BODY_HELP = "let the sound pass through a violin's body, modelled by five resonances"


def add_command(commands: Any) -> None:
    """Add the parser of `inspect`; its default `run` takes the parsed arguments."""
    parser = commands.add_parser(
        "inspect",
        help="single cells of a run: see and hear them",
        formatter_class=argparse.RawDescriptionHelpFormatter,
        description="Show cells of a run in the rerun viewer, a tab for each: bridge force and slips, surface\n"
        "velocity, pitch and regime over time, friction plane, spectrum with harmonics, sound.\n\n"
        "A cell is chosen by the values of the map's axes (the nearest cell is taken) or by its number,\n"
        "iy * nx + ix. Its waveform is read from the run's bag, and its checksums are checked. Without a bag, or with\n"
        "--computed, the cell is simulated again, and held against what is recorded, bit for bit.\n\n"
        "The cells are added to the recording RUN/cells.rrd, which keeps the last 12; dashboard.rrd is not changed.",
        epilog="examples:\n"
        "  bow inspect runs/fig11d --at f_asym=3.1,f_init_ratio=0.67\n"
        "  bow inspect runs/fig11d --cell 4160 --cell 4161             two cells side by side\n"
        "  bow inspect runs/sure --cell 100 --repeat 0 --repeat 3      a cell, and its third repeat\n"
        "  bow inspect runs/fig11d --cell 4160 --wav a.wav --seconds 3 --body\n"
        "  bow inspect runs/fig11d --cell 4160 --plot cell.png --no-view\n\n"
        "exit status: 0 done; 1 a waveform is not the recorded one, or a file cannot be written; 2 wrong usage",
    )
    parser.add_argument("run_directory", metavar="RUN", type=Path, help="run directory of `bow sweep`")
    parser.add_argument("--at", metavar="NAME=VALUE,...", action="append", default=[], dest="places",
                        help="the cell nearest to these values of the map's two axes; may be given again")  # fmt: skip
    parser.add_argument("--cell", metavar="N", type=int, action="append", default=[], dest="cells",
                        help="the cell with this number; may be given again")  # fmt: skip
    parser.add_argument("--repeat", metavar="R", type=int, action="append", default=[], dest="repeats",
                        help="repeat R of the chosen cells, of a run with repeats; 0 is the cell itself; may be "
                        "given again")  # fmt: skip
    parser.add_argument("--computed", action="store_true", help="simulate the cell again, even if the bag has it")
    parser.add_argument("--save", metavar="F.rrd", type=Path, help="add the cells to this recording instead")
    parser.add_argument("--no-view", action="store_true", help="write the recording, but open no viewer")
    parser.add_argument("--plot", metavar="F", type=Path, help="also draw the cell: .png, .svg or .pdf by its suffix")
    parser.add_argument(
        "--wav", metavar="F.wav", type=Path, help="also write the bridge force as sound, 48 kHz, 16 bit"
    )
    parser.add_argument("--seconds", metavar="S", type=float, help=SOUND_HELP)
    parser.add_argument("--body", action="store_true", help=BODY_HELP)
    parser.set_defaults(run=_inspect)


def _inspect(args: argparse.Namespace) -> int:
    from bow_sim.figures.page import FigureError
    from bow_sweep.cell.run_cells import RunCells
    from bow_sweep.cell.sound import SoundError
    from bow_sweep.cell.waveform import CellError
    from bow_sweep.processes.progress import percentages

    try:
        _check_files(args)
        with RunCells(args.run_directory, percentages("reading the bag")) as cells:
            chosen = _chosen(args, cells)
            records = [cells.record(cell, "computed" if args.computed else "auto") for cell in chosen]
            recording = _kept(args, cells, chosen)
            return _show(args, cells, records, recording)
    except (CellError, FigureError, SoundError) as error:
        return fail(str(error))


def _check_files(args: argparse.Namespace) -> None:
    """Refuse what cannot be written before anything is computed."""
    from bow_sim.figures.page import check_path
    from bow_sweep.cell.waveform import CellError

    if args.save and args.save.suffix.lower() != ".rrd":
        raise CellError(f"--save {args.save}: should end in .rrd")
    if args.plot:
        check_path(args.plot)
    check_sound(args)


def check_sound(args: argparse.Namespace) -> None:
    """Check the options --wav, --seconds and --body.

    Raises
    ------
    SoundError
        For a wrong suffix or length, or where there is no sound that they say something of.
    """
    from bow_sweep.cell.sound import SoundError, check_seconds, check_wav

    if args.wav:
        check_wav(args.wav)
    elif args.seconds is not None or args.body:
        raise SoundError(f"{'--body' if args.body else '--seconds'} says how the sound should be: give --wav F.wav too")
    if args.seconds is not None:
        check_seconds(args.seconds)


def _chosen(args: argparse.Namespace, cells: RunCells) -> list[int]:
    """Return the cells that were asked for, each once."""
    from bow_sim.physics.kinds import value_text
    from bow_sweep.cell.waveform import CellError

    if not (args.places or args.cells):
        axes = " and ".join(
            f"{a.name} from {value_text(a.name, a.values[0], 'g')} to {value_text(a.name, a.values[-1], 'g')}"
            for a in cells.map.axes
        )
        example = ",".join(f"{a.name}={value_text(a.name, a.values[a.count // 2], '.3g')}" for a in cells.map.axes)
        raise CellError(f"no cell is chosen: the map has {axes}; for instance --at {example}")
    chosen = [cells.nearest(values_in(text)) for text in args.places] + args.cells
    if wrong := [repeat for repeat in args.repeats if not 0 <= repeat <= cells.repeats]:
        has = f"repeats 1 ... {cells.repeats} of each cell" if cells.repeats else "no repeats"
        raise CellError(f"--repeat {wrong[0]}: this run has {has}; 0 is the cell itself")
    if args.repeats:
        chosen = [repeat * cells.cells + cell % cells.cells for cell in chosen for repeat in args.repeats]
    return list(dict.fromkeys(chosen))  # a cell that was chosen twice is shown once


def values_in(text: str) -> dict[str, float]:
    """Return the values in a text of the form "name=value,name=value".

    Raises
    ------
    CellError
        For a text of another form.
    """
    from bow_sim.physics.errors import ParameterError
    from bow_sim.physics.kinds import number_of
    from bow_sweep.cell.waveform import CellError

    values = {}
    for part in text.split(","):
        name, separator, value = (word.strip() for word in part.partition("="))
        try:
            number = number_of(name, value)
        except ParameterError as error:
            raise CellError(f"--at {text}: {error}") from None
        except ValueError:
            separator = ""
        if not separator or not name:
            raise CellError(f"--at {text}: {part!r} should be name=value, such as f_asym=3.1")
        if name in values:
            raise CellError(f"--at {text}: {name} is given twice; give --at twice for two cells")
        values[name] = number
    return values


def _kept(args: argparse.Namespace, cells: RunCells, chosen: Sequence[int]) -> list[CellRecord] | None:
    """Return the cells for the recording: those already in it, then the chosen ones; None without rerun."""
    from bow_sweep.cell.waveform import CellError

    try:
        from bow_sweep.view.cell_views import MOST, cells_in
    except ImportError:
        warn("rerun is not installed, so there is no recording of the cells")
        return None
    if len(chosen) > MOST:
        raise CellError(f"{len(chosen)} cells: a recording holds {MOST}; choose fewer")
    try:
        before = cells_in(_recording(args), cells.map.run_id)
    except ValueError as error:
        raise CellError(str(error)) from None
    earlier = [cell for cell in before if cell not in chosen and cell < cells.cells * (1 + cells.repeats)]
    if left_out := earlier[: max(0, len(earlier) + len(chosen) - MOST)]:
        warn(f"{_recording(args)} holds {MOST} cells: cell {', '.join(map(str, left_out))} is left out now")
    source = "computed" if args.computed else "auto"
    return [
        *(cells.record(cell) for cell in earlier[len(left_out) :]),
        *(cells.record(cell, source) for cell in chosen),
    ]


def _recording(args: argparse.Namespace) -> Path:
    from bow_sweep.view.cell_views import FILE

    return args.save or args.run_directory / FILE


def _show(
    args: argparse.Namespace, cells: RunCells, records: Sequence[CellRecord], recording: Sequence[CellRecord] | None
) -> int:
    """Print what is known of the cells, and write the files; return the exit status."""
    from bow_sweep.cell.portrait import Portrait
    from bow_sweep.processes.progress import percentages

    portraits, progress = {}, percentages("simulating and analysing the cells")
    everything = recording or records
    for number, record in enumerate(everything, 1):
        portraits[record.cell] = Portrait.of(record)
        progress(number, len(everything))
    status = DONE
    for record in records:
        print(record.title)
        for name, text in portraits[record.cell].facts()[2:]:
            print(f"  {name:17} {text}")
        if record.repeat:
            print(f"  {'parting':17} {_parting(record, cells)}")
        if record.checked is False:
            warn(f"cell {record.cell}: its waveform is not the recorded one: {record.why}")
            status = FAILED
    try:
        _write_pictures(args, records, portraits)
        if recording is None:
            return status
        from bow_sweep.view.cell_views import write_cells

        write_cells(_recording(args), [portraits[record.cell] for record in recording])
        print(f"wrote {_recording(args)}: {len(recording)} cell{'s' * (len(recording) > 1)}")
    except OSError as error:
        return fail(f"{error.filename or 'a file'}: cannot be written: {error.strerror}", FAILED)
    if not args.no_view:
        _open(_recording(args))
    return status


def _parting(record: CellRecord, cells: RunCells) -> str:
    """Return in words when the motion of a repeat parts from that of its cell."""
    from bow_sweep.cell.parting import APART, parting

    periods = parting(record, cells.record(record.cell % cells.cells), record.period)
    if periods == float("inf"):
        return f"never: all slips begin within {APART} samples of those of the cell"
    return f"from the cell after {periods:.1f} periods: a slip begins more than {APART} samples earlier or later"


def _write_pictures(args: argparse.Namespace, records: Sequence[CellRecord], portraits: dict[int, Portrait]) -> None:
    """Write picture and sound of each cell; of several cells the number is added to the names."""
    for record in records:
        if args.plot:
            from bow_sweep.cell.picture import draw_cell

            path = _own_path(args.plot, record, len(records))
            draw_cell(path, portraits[record.cell])
            print(f"wrote {path}")
        if args.wav:
            from bow_sweep.cell.sound import save_wav, sound_of

            path = _own_path(args.wav, record, len(records))
            made = sound_of(record.bridge_force, record.parameters, args.seconds, args.body)
            save_wav(path, made.samples)
            print(f"wrote {path}: {made.describe()}")


def _own_path(path: Path, record: CellRecord, records: int) -> Path:
    return path if records == 1 else path.with_stem(f"{path.stem}-{record.cell}")


def _open(path: Path) -> None:
    """Open a recording in a viewer, which goes on when this command ends."""
    from bow_sweep.view.viewer import Viewer
    from bow_sweep.view.wanted import NO_DISPLAY, has_display

    by_hand = f"open it where there is one: rerun {path}"
    if not has_display():
        warn(f"{NO_DISPLAY} (DISPLAY and WAYLAND_DISPLAY are empty); {by_hand}")
        return
    try:
        viewer = Viewer(str(path))
    except OSError as error:
        warn(f"no viewer can be started: {error}; {by_hand}")
        return
    end = time.monotonic() + VIEWER_WAIT_S
    while time.monotonic() < end:
        reason = viewer.ended()
        if reason is not None:
            if reason:
                warn(f"{reason}; {by_hand}")
            return
        time.sleep(0.1)
