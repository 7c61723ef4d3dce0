"""Messages are escaped, and name flags and commands."""

from posefuse.report.messages import message_html


def test_arguments_and_functions_are_flags_and_commands():
    html = message_html("Set `rate_hz=60`, or run `posefuse.measure_sync`; see <b>.")
    assert html == "Set <code>--rate-hz 60</code>, or run <code>posefuse sync</code>; see &lt;b&gt;."


def test_values_are_escaped():
    assert "<script>" not in message_html("`exclude_camera=['<script>']`")
