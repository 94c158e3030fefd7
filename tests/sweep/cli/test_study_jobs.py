"""Which maps a resumed study makes: exactly those that are missing or not finished."""

from pathlib import Path

import pytest
from hypothesis import given, settings
from hypothesis import strategies as st

from bow_sweep.cli.sweep_jobs import begin_study, resume, resume_study
from bow_sweep.coordinator.resume import Prepared
from bow_sweep.plan.sweep import Sweep
from bow_sweep.run.directory import SEARCH, STUDY, RunError
from bow_sweep.study.over import over_of
from bow_sweep.study.plan import Study

SMALL = ("x.count=4", "y.count=2", "periods=10")
ASKED = Study("fig11d", SMALL, (over_of("mu_s=0.8,1.0"), over_of("v_mid=-2,0.2,0.9")))
MISSING, EMPTY, BEGUN, FINISHED = "missing", "empty", "begun", "finished"


def directory_in(place: Path, states: list[str]) -> Path:
    """A study of which each run is in one of these states."""
    work = begin_study(ASKED, "", place / "study", lock=True)
    work.owned.new = False
    work.owned.release()
    for member, state in zip(ASKED.members, states, strict=True):
        run = work.owned.directory / member.name
        if state != MISSING:
            run.mkdir()
        if state in (BEGUN, FINISHED):
            (run / "ledger.jsonl").write_text(state)
    return work.owned.directory


def prepared(run: Path, *_: object) -> Prepared:
    """Stand in for the reading of ledger and bag: the state is in the ledger's file."""
    sweep = {member.name: member.sweep for member in ASKED.members}[run.name]
    return Prepared("a" * 16, sweep, None, (run / "ledger.jsonl").read_text() == FINISHED)  # type: ignore[arg-type]


states = st.lists(st.sampled_from([MISSING, EMPTY, BEGUN, FINISHED]), min_size=6, max_size=6)


@settings(max_examples=12, deadline=None)
@given(states)
def test_a_resumed_study_makes_exactly_what_is_missing_and_goes_on_with_what_is_not_finished(tmp_path_factory, states):
    directory = directory_in(tmp_path_factory.mktemp("study"), states)
    with pytest.MonkeyPatch.context() as patch:
        patch.setattr("bow_sweep.coordinator.resume.prepare", prepared)
        work = resume_study(directory)
    work.owned.release()
    expected = [
        (member.name, member.sweep, state == BEGUN)
        for member, state in zip(ASKED.members, states, strict=True)
        if state != FINISHED
    ]
    assert [(job.directory.name, job.sweep, job.resume) for job in work.jobs] == expected
    assert work.study == ASKED
    new = [job.run_id for job in work.jobs if not job.resume]
    assert len(set(new)) == len(new)


def test_a_run_of_other_settings_in_a_study_is_refused_by_name(tmp_path, monkeypatch):
    directory = directory_in(tmp_path, [FINISHED] * 6)
    other = Sweep.from_spec("fig11d", [*SMALL, "mu_s=0.9"])
    monkeypatch.setattr("bow_sweep.coordinator.resume.prepare", lambda run, *_: prepared(run)._replace(sweep=other))
    with pytest.raises(RunError, match=r"0_mu_s=0.8_v_mid=-2.*other settings"):
        resume(directory, lock=True)


def test_the_directory_of_a_search_says_which_command_goes_on_with_it(tmp_path):
    (tmp_path / SEARCH).touch()
    with pytest.raises(RunError, match=f"bow optimise --resume {tmp_path}"):
        resume(tmp_path, lock=True)


def test_the_directory_of_a_study_is_not_taken_for_another(tmp_path):
    directory = directory_in(tmp_path, [FINISHED] * 6)
    with pytest.raises(RunError, match=f"--resume {directory}"):
        begin_study(ASKED, "", directory, lock=True)
    assert (directory / STUDY).exists()
