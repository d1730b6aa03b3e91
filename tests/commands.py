"""What tests of the command line share: the demo's logs, a model with effects, and how a refusal
looks."""

from pathlib import Path

DEMO = Path(__file__).parents[1] / "configs" / "demo"

EXTENDED = {
    "schema": "vdmsi.model/1",
    "vehicle": {"l_f": 1.75, "l_r": 1.20},
    "plants": {
        "powertrain": {
            "input": "v_cmd",
            "output": "v",
            "num": [2.21, 143.9],
            "den": [1.0, 18.15, 143.2],
        },
        "steering": {
            "input": "delta_cmd",
            "output": "delta",
            "num": [15.5],
            "den": [1.0, 16.667],
            "effects": [
                {"cause": "transport_delay", "parameters": {"delay": 0.045}},
                {"cause": "backlash", "parameters": {"gap": 0.001}},
            ],
        },
    },
    "body": [{"cause": "understeer", "parameters": {"gradient": 0.0002}}],
    "sensors": [{"channel": "v", "cause": "sensor_bias", "parameters": {"bias": 0.3}}],
}


def refused(done) -> str:
    assert done.returncode == 2, done.stderr
    assert done.stdout == ""
    assert done.stderr.endswith("\n") and done.stderr.count("\n") == 1, done.stderr
    assert "Traceback" not in done.stderr
    return done.stderr
