"""Project files: posefuse init, then posefuse reconstruct --options, without another argument."""

import posefuse


def test_reconstruct_runs_a_project_file_unchanged(run, recording, tmp_path):
    path = recording / "posefuse.toml"
    assert run("init", path)[0] == 0
    code, output, _ = run("reconstruct", "--options", path)
    assert code == 0, output
    assert run("reconstruct", "--options", path)[0] == 0
    path.unlink()
    assert run("reconstruct", recording, "--output", tmp_path / "plain")[0] == 0
    plain, result = (
        posefuse.read_reconstruction(folder / "reconstruction.nc") for folder in (tmp_path / "plain", recording / "out")
    )
    assert result.options == plain.options
    assert result.layers == plain.layers


def test_flags_override_a_project_file(run, recording, tmp_path):
    path = tmp_path / "project.toml"
    path.write_text('recording = "recording"\noutput = "a"\nend_s = 0.5\n')
    assert run("reconstruct", "--options", path)[0] == 0
    assert run("reconstruct", recording, "--options", path, "--output", tmp_path / "b", "--end-s", "0.2")[0] == 0
    frames = [posefuse.read_reconstruction(tmp_path / name / "reconstruction.nc").n_frames for name in ("a", "b")]
    assert frames == [15, 6]
    code, output, _ = run("inspect", "--options", path)
    assert code == 0
    assert "4 views match 4 cameras" in output


def test_options_with_the_names_of_commands_are_used(run, recording, tmp_path):
    project = tmp_path / "own.toml"
    project.write_text(
        'people = "one"\n[sync]\ncameras = ["cam_1"]\nstart_s = [0.0]\noffset_s = [0.1]\ndrift_ppm = [0.0]\n'
    )
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--options", project)
    assert code == 0, output
    options = posefuse.read_reconstruction(tmp_path / "o" / "reconstruction.nc").options
    assert (options.people, options.sync.offset_s) == ("one", (0.1,))


def test_project_file_with_every_option_runs(run, recording, tmp_path):
    assert run("init", tmp_path / "all.toml", "--all")[0] == 0
    code, _, output = run("reconstruct", recording, "-o", tmp_path / "o", "--options", tmp_path / "all.toml")
    assert code == 0, output
    assert run("reconstruct", recording, "-o", tmp_path / "plain")[0] == 0
    plain, result = (posefuse.read_reconstruction(tmp_path / name / "reconstruction.nc") for name in ("plain", "o"))
    assert result.options == plain.options
