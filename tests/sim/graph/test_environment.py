"""Variables and open files of the caller do not affect the graph, or are refused by name."""

from __future__ import annotations

import os
import signal
import subprocess
import sys
from pathlib import Path

import pytest

from bow_sim.graph import environment
from bow_sim.graph.environment import EnvironmentProblem, check, cleaned

CODE = "from bow_sim.graph.environment import prepare; prepare(); import os, sys; "


def python(code: str, **options: object) -> subprocess.CompletedProcess[str]:
    return subprocess.run([sys.executable, "-c", CODE + code], capture_output=True, text=True, check=False, **options)


@pytest.fixture
def wheels(monkeypatch: pytest.MonkeyPatch) -> list[str]:
    """As if ROS came from wheels with these libraries."""
    libraries = ["/ours/lib", "/ours/ros_x.libs"]
    monkeypatch.setattr(environment, "wheel_libraries", lambda: libraries)
    return libraries


@pytest.fixture
def foreign(tmp_path: Path) -> Path:
    """A ROS installation, as a sourced setup.bash puts it into the environment."""
    (tmp_path / "lib").mkdir()
    (tmp_path / "lib" / "librcl.so").touch()
    (tmp_path / "python" / "rclpy").mkdir(parents=True)
    return tmp_path


def test_a_sourced_ros_does_not_affect_the_wheels_and_other_variables_stay(wheels: list[str], foreign: Path) -> None:
    given = {
        "LD_LIBRARY_PATH": f"{foreign}/lib:/cuda/lib",
        "PYTHONPATH": f"{foreign}/python:/mine",
        "AMENT_PREFIX_PATH": str(foreign),
        "HOME": "/me",
    }
    right = cleaned(given)
    assert right["LD_LIBRARY_PATH"].split(":") == [*wheels, "/cuda/lib"]
    assert right["PYTHONPATH"] == "/mine"
    assert "AMENT_PREFIX_PATH" not in right
    assert right["HOME"] == "/me"
    assert cleaned(right) == right


@pytest.mark.parametrize("name", ["rclpy", "bow_msgs"])
def test_a_command_names_the_package_without_which_no_graph_starts(name: str, tmp_path: Path) -> None:
    code = (
        "import importlib.util, sys; find = importlib.util.find_spec;"
        f"importlib.util.find_spec = lambda name: None if name == {name!r} else find(name);"
        "from bow_sweep.cli import main; sys.exit(main(['sweep', 'fig11d', '--out', sys.argv[1]]))"
    )
    command = [sys.executable, "-c", code, str(tmp_path / "run")]
    done = subprocess.run(command, capture_output=True, text=True, timeout=60, check=False)
    assert done.returncode == 2
    assert f"no graph starts without the package {name}, " in done.stderr
    assert sys.executable in done.stderr
    assert not (tmp_path / "run").exists()


def test_where_ros_is_not_from_wheels_its_variables_stay(monkeypatch: pytest.MonkeyPatch, foreign: Path) -> None:
    monkeypatch.setattr(environment, "wheel_libraries", list)
    given = {"LD_LIBRARY_PATH": f"{foreign}/lib", "PYTHONPATH": f"{foreign}/python", "AMENT_PREFIX_PATH": str(foreign)}
    assert cleaned(given).items() >= given.items()


@pytest.mark.parametrize("given", [":", "", ":/mine", "/mine::"])
def test_an_empty_entry_of_the_path_is_not_the_working_directory(given: str) -> None:
    assert cleaned({"PYTHONPATH": given}).get("PYTHONPATH") in (None, "/mine")


@pytest.mark.parametrize(
    ("name", "value"),
    [
        ("ROS_DOMAIN_ID", "300"),
        ("ROS_DOMAIN_ID", "233"),
        ("ROS_DOMAIN_ID", "-1"),
        ("ROS_DOMAIN_ID", "abc"),
        ("ROS_DOMAIN_ID", "1.5"),
        ("RCUTILS_COLORIZED_OUTPUT", "yes"),
        ("RCUTILS_LOGGING_USE_STDOUT", "true"),
        ("RCUTILS_LOGGING_BUFFERED_STREAM", "2"),
        ("ROS_AUTOMATIC_DISCOVERY_RANGE", "EVERYWHERE"),
        ("ROS_STATIC_PEERS", "nowhere.invalid"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", "/nowhere.xml"),
        ("FASTRTPS_DEFAULT_PROFILES_FILE", __file__),
    ],
)
def test_what_no_graph_can_start_with_is_refused_by_name(name: str, value: str) -> None:
    with pytest.raises(EnvironmentProblem, match=name) as problem:
        check({name: value})
    assert "should be" in str(problem.value)


@pytest.mark.parametrize("value", ["", "0", "7", " 7", "232"])
def test_a_domain_that_works_is_taken(value: str) -> None:
    check({"ROS_DOMAIN_ID": value})


def test_security_that_is_enforced_without_keys_is_refused(tmp_path: Path) -> None:
    given = {"ROS_SECURITY_ENABLE": "true", "ROS_SECURITY_STRATEGY": "Enforce", "ROS_SECURITY_KEYSTORE": str(tmp_path)}
    with pytest.raises(EnvironmentProblem, match="ROS_SECURITY_ENABLE"):
        check(given)
    (tmp_path / "enclaves").mkdir()
    check(given)
    check({"ROS_SECURITY_ENABLE": "true"})


def test_another_middleware_is_ignored_and_named(monkeypatch: pytest.MonkeyPatch) -> None:
    for name, value in cleaned(os.environ).items():  # clean() writes them
        monkeypatch.setenv(name, value)
    monkeypatch.setenv("RMW_IMPLEMENTATION", "rmw_cyclonedds_cpp")
    assert "rmw_cyclonedds_cpp is ignored" in environment.clean()
    assert "RMW_IMPLEMENTATION" not in os.environ
    assert environment.clean() == ""


def test_a_process_is_started_again_if_its_libraries_were_those_of_another_python(foreign: Path) -> None:
    """The mark of the wheels is inherited from another Python, and its libraries with it."""
    given = {**os.environ, "_ROS_WHEELS_BOOTSTRAP_COMPLETE": "1", "LD_LIBRARY_PATH": f"{foreign}/lib"}
    given["PYTHONPATH"] = f"{foreign}/python{os.pathsep}/mine"
    done = python("import rclpy.impl.implementation_singleton; print(sys.path, os.environ)", env=given)
    assert done.returncode == 0, done.stderr
    assert str(foreign) not in done.stdout
    assert "/mine" in done.stdout
    assert "_BOW_STARTED_AGAIN" not in done.stdout


@pytest.mark.parametrize("closed", ["<&-", ">&-", "2>&-", "<&- >&- 2>&-"])
def test_closed_streams_are_opened_on_dev_null_for_a_process_and_its_children(closed: str, tmp_path: Path) -> None:
    out = tmp_path / "out"
    child = f"import os; [os.fstat(n) for n in range(3)]; open({str(out)!r}, 'w').write('all open')"
    code = f"{CODE} print(1); print(2, file=sys.stderr); sys.stdin.read(); "
    code += f"import subprocess; subprocess.run([sys.executable, '-c', {child!r}], check=True)"
    subprocess.run(["bash", "-c", f'exec "$0" -c "$1" {closed}', sys.executable, code], check=True, timeout=60)
    assert out.read_text() == "all open"


@pytest.mark.parametrize(("given", "expected"), [({}, "1"), ({environment.BLAS_THREADS: "2"}, "2")])
def test_libraries_start_no_threads_that_are_not_asked_for(given: dict[str, str], expected: str) -> None:
    inherited = {name: value for name, value in os.environ.items() if name != environment.BLAS_THREADS}
    code = "import numpy, scipy.linalg; print(len(os.listdir('/proc/self/task')), os.environ['OPENBLAS_NUM_THREADS'])"
    done = python(code, env={**inherited, **given})
    threads, number = done.stdout.split()
    assert number == expected, done.stderr
    assert expected != "1" or threads == "1"


def test_children_have_exit_statuses_where_the_caller_ignored_them() -> None:
    code = "child = os.fork() or os._exit(7); print(os.waitstatus_to_exitcode(os.waitpid(child, 0)[1]))"
    done = python(code, preexec_fn=lambda: signal.signal(signal.SIGCHLD, signal.SIG_IGN))
    assert done.stdout == "7\n", done.stderr


def test_a_working_directory_that_is_gone_is_left(tmp_path: Path) -> None:
    gone = tmp_path / "gone"
    gone.mkdir()
    done = python("print(os.getcwd())", cwd=gone, preexec_fn=gone.rmdir)
    assert done.returncode == 0, done.stderr
    assert "gone" not in done.stdout
