"""Session and subject of NWB files."""

from dataclasses import replace

import pytest

import posefuse
from posefuse import Options
from posefuse.cli.main import main
from posefuse.errors import OptionsError
from posefuse.io.results import nwb_session
from posefuse.model.options.subject import SubjectOptions
from tests.properties.test_result_files import some_result

pytest.importorskip("ndx_pose", reason="ndx-pose is an optional package")
pytestmark = pytest.mark.filterwarnings("ignore")

START = "2024-05-03T14:30:00+02:00"
KNOWN = Options(
    session_start=START,
    subject=SubjectOptions(id="s01", species="Mus musculus", sex="F", age="P90D", date_of_birth="2024-02-03"),
)


@pytest.fixture
def result():
    return some_result(3, ["anna"], ["nose", "tail", "left_paw", "right_paw"], ["a", "b"], 6)


def content_of(path):
    import pynwb

    with pynwb.NWBHDF5IO(path, "r") as opened:
        content = opened.read()
        subject = content.subject
        fields = (
            None if subject is None else {name: getattr(subject, name) for name in ("subject_id", "species", "sex")}
        )
        return content.session_start_time, content.session_description, fields


def messages_of(path, importance):
    """Return the messages of the inspector, with the profile of the archive DANDI."""
    inspector = pytest.importorskip("nwbinspector", reason="nwbinspector is not installed")
    config = inspector.load_config("dandi")
    found = list(inspector.inspect_nwbfile(nwbfile_path=str(path), config=config))
    return [message.message for message in found if message.importance.name in importance]


def test_without_options_the_file_says_that_the_start_is_unknown(result, tmp_path):
    written = posefuse.write(result, tmp_path / "x.nwb")
    start, description, subject = content_of(tmp_path / "x.nwb")
    assert start == nwb_session.UNKNOWN_START
    assert "the session start is unknown, 1970 is a placeholder" in description
    assert subject is None
    assert any("start of the session is unknown and written as 1970; set `session_start`" in n for n in written.notes)
    missing = "`subject.id`, `subject.species`, `subject.sex`, `subject.age`"
    assert any(missing in note for note in written.notes)


def test_options_state_session_and_subject(result, tmp_path):
    import pynwb

    written = posefuse.write(replace(result, options=KNOWN), tmp_path / "x.nwb")
    assert not any(note.startswith("nwb: ") and "missing" in note for note in written.notes)
    start, description, subject = content_of(tmp_path / "x.nwb")
    assert start.isoformat() == START
    assert "1970" not in description
    assert subject == {"subject_id": "s01", "species": "Mus musculus", "sex": "F"}
    errors = pynwb.validate(path=str(tmp_path / "x.nwb"))
    assert list(errors[0] if isinstance(errors, tuple) else errors) == []
    posefuse.write(replace(result, options=KNOWN), tmp_path / "again.nwb")
    assert (tmp_path / "again.nwb").read_bytes() == (tmp_path / "x.nwb").read_bytes()


def test_the_inspector_finds_nothing_critical(result, tmp_path):
    posefuse.write(replace(result, options=KNOWN), tmp_path / "x.nwb")
    assert messages_of(tmp_path / "x.nwb", ("CRITICAL", "PYNWB_VALIDATION", "ERROR")) == []
    posefuse.write(result, tmp_path / "unknown.nwb")
    assert messages_of(tmp_path / "unknown.nwb", ("CRITICAL",)) == ["Subject is missing."]


def test_convert_states_them_for_a_stored_result(result, tmp_path):
    stored = tmp_path / "result" / "reconstruction.nc"
    posefuse.write(replace(result, options=Options(subject=SubjectOptions(id="s01"))), stored)
    output = tmp_path / "x.nwb"
    main(["convert", str(stored), str(output), "--session-start", START, "--subject.species", "Homo sapiens",
          "--subject.sex", "U", "--subject.date-of-birth", "1998-04-12"])  # fmt: skip
    start, _, subject = content_of(output)
    assert start.isoformat() == START
    assert subject == {"subject_id": "s01", "species": "Homo sapiens", "sex": "U"}


@pytest.mark.parametrize(
    ("options", "words"),
    [
        ({"session_start": "yesterday"}, "session_start must be an ISO 8601 date or time"),
        ({"session_start": "2024-05-03T14:30:00"}, "session_start needs a time zone"),
        ({"subject": {"id": "a/b"}}, "subject.id must be a name without slashes"),
        ({"subject": {"species": "mouse"}}, "subject.species must be a Latin name"),
        ({"subject": {"age": "25"}}, "subject.age must be an ISO 8601 duration"),
        ({"subject": {"age": "P"}}, "subject.age must be an ISO 8601 duration"),
        ({"subject": {"sex": "female"}}, "sex"),
        ({"subject": {"date_of_birth": "12.4.98"}}, "subject.date_of_birth must be an ISO 8601 date"),
        (
            {"session_start": START, "subject": {"date_of_birth": "2025-01-01"}},
            r"subject.date_of_birth \(2025-01-01\) must be before session_start",
        ),
    ],
)
def test_invalid_values_are_refused(options, words):
    with pytest.raises(OptionsError, match=words):
        Options(**{**options, "subject": SubjectOptions(**options.get("subject", {}))})


@pytest.mark.parametrize("age", ["P25Y", "P1Y6M", "P12W", "P90D", "P20Y/P30Y", "P90D/", "PT36H"])
def test_ages_are_durations_or_ranges(age):
    assert SubjectOptions(age=age).age == age
