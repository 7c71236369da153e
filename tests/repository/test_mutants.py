"""The tool that tries mutants: what it draws, what it puts into code, and that it goes on where it ended."""

import ast
from pathlib import Path

import pytest
from mutants import Drawn, Progress, Results, draw, equivalents
from mutation import mutants_of, mutated_source

SOURCE = '''"""Module."""

from skinnet.compilation import compiled


@compiled
def reach_m(speed_m_s: float, step_s: float = 0.001) -> float:
    """Reach."""
    if speed_m_s <= 0.0:
        raise ValueError(f"{1 + speed_m_s} is no speed")
    return max(2.0 * speed_m_s, 1.0)
'''
SUBJECT = "touch"


def repository(folder: Path) -> Path:
    """A repository with one module of the touch controller, and one test."""
    for name, text in (
        ("controller/touch/reach.py", SOURCE),
        ("tests/controller/touch/test_reach.py", "A = 1\n"),
    ):
        (folder / name).parent.mkdir(parents=True)
        (folder / name).write_text(text)
    return folder


def test_every_mutant_is_one_change_of_what_runs(tmp_path: Path) -> None:
    root = repository(tmp_path)
    mutants = mutants_of(root / "controller/touch/reach.py", root)
    changes = {(m.before, m.after) for m in mutants}
    assert len(changes) == len(mutants) > 5
    assert ("if speed_m_s <= 0.0:", "if speed_m_s < 0.0:") in changes
    assert ("return max(2.0 * speed_m_s, 1.0)", "return max(2.0 / speed_m_s, 1.0)") in changes
    assert ("return max(2.0 * speed_m_s, 1.0)", "return min(2.0 * speed_m_s, 1.0)") in changes
    assert not [after for _, after in changes if after.startswith(("raise", "@", "from"))]
    assert {m.function for m in mutants} == {"reach_m"}
    sound = ast.unparse(ast.parse(SOURCE)).splitlines()
    for mutant in mutants:
        faulty = mutated_source(SOURCE, mutant).splitlines()
        assert sum(a != b for a, b in zip(sound, faulty, strict=True)) == 1
        assert mutant.after in "\n".join(faulty)


def test_a_draw_is_reproducible_and_takes_the_subjects_in_turn() -> None:
    root = Path(__file__).parents[2]
    drawn = draw(root, 6, 3, ("metrics", "touch"))
    assert drawn == draw(root, 6, 3, ("metrics", "touch"))
    assert [each.subject for each in drawn] == ["metrics", "touch"] * 3
    assert drawn != draw(root, 6, 4, ("metrics", "touch"))


def test_a_second_start_goes_on_where_the_first_ended(tmp_path: Path) -> None:
    root, path = repository(tmp_path), tmp_path / "results.jsonl"
    drawn = draw(root, 5, 1, (SUBJECT,))
    results = Results(path, root)
    results.add(drawn[0], outcome="killed", by="tests/x.py::test_y", seconds=1.0)
    results.add(drawn[1], outcome="survived", by="", seconds=1.0)
    with path.open("a") as file:
        file.write('{"key": "half a li')  # the run was ended here
    after = Results(path, root)
    verdicts = {drawn[2].mutant.change: "it changes nothing"}
    assert Progress(drawn, after, verdicts).open(compiled=False) == drawn[3:]
    after.add(drawn[3], outcome="timeout", by="", seconds=1.0)
    progress = Progress(drawn, Results(path, root), verdicts)
    assert [progress.outcome(each) for each in drawn] == [
        "killed",
        "survived",
        "equivalent",
        "timeout",
        "open",
    ]
    head, *lines = progress.summary()
    assert head.split() == ["subject", "killed", "survived", "equivalent", "open", "share", "killed"]
    assert lines[0].split() == [SUBJECT, "2", "1", "1", "1", "67", "%"], "what changes nothing does not count"
    assert [line for line in lines if line.startswith("survived:")] == lines[2:3]


@pytest.mark.parametrize("name", ["controller/touch/reach.py", "tests/controller/touch/test_reach.py"])
def test_results_are_of_one_source_and_its_tests(tmp_path: Path, name: str) -> None:
    root, path = repository(tmp_path), tmp_path / "results.jsonl"
    drawn: Drawn = draw(root, 1, 1, (SUBJECT,))[0]
    Results(path, root).add(drawn, outcome="killed", by="tests/x.py::test_y", seconds=1.0)
    (root / name).write_text((root / name).read_text() + "B = 2\n")
    after = Results(path, root)
    assert after.of(drawn) is None
    assert after.killer_before(drawn) == ("tests/x.py::test_y" if name.startswith("tests") else "")


def test_verdicts_have_reasons(tmp_path: Path) -> None:
    assert all(equivalents().values())
    path = tmp_path / "verdicts.toml"
    path.write_text(
        '[[equivalent]]\npath = "a.py"\nfunction = "f"\nbefore = "x"\nafter = ["y"]\nreason = ""\n'
    )
    with pytest.raises(ValueError, match="no reason"):
        equivalents(path)
