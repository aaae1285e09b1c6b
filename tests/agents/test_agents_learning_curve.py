"""Learning curves: what is read, and what is refused in one line."""

import re

import pytest

from agents.learning_curve import read_curve

HEAD = "steps,seconds,phase,success,time_to_goal,return_\n"
CURVE = HEAD + "0,0,imitation,0,,-20\n1000,2.5,imitation,0.5,2.0,-3\n9000,10,ppo,1,1.5,4\n"


def test_a_curve_is_read(tmp_path):
    path = tmp_path / "curve.csv"
    path.write_text("phase,steps,success,seconds,return_,time_to_goal\nppo,8,0.25,1.5,-2,3.25\n")
    curve = read_curve(path, "curve")
    assert (curve.steps.tolist(), curve.seconds.tolist(), curve.phase.tolist()) == ([8], [1.5], ["ppo"])
    assert (curve.success.tolist(), curve.time_to_goal.tolist(), curve.return_.tolist()) == ([0.25], [3.25], [-2.0])


BAD_CURVES = {
    "nothing": ("", "line 1"),
    "no line": (HEAD, "line 1"),
    "another column": (CURVE.replace("return_", "reward"), "return_"),
    "a value too few": (HEAD + "1,2,ppo,0.5,2\n", "line 2"),
    "no number": (HEAD + "1,2,ppo,much,2,3\n", "line 2.success"),
    "more than all": (HEAD + "1,2,ppo,50,2,3\n", "line 2.success"),
    "infinite": (HEAD + "1,inf,ppo,0.5,2,3\n", "line 2.seconds"),
    "half a step": (HEAD + "1.5,2,ppo,0.5,2,3\n", "line 2.steps"),
    "steps that fall": (HEAD + "5,2,ppo,0.5,2,3\n4,3,ppo,0.5,2,3\n", "line 3: steps"),
    "success without a time": (HEAD + "5,2,ppo,0.5,,3\n", "line 2: missing field 'time_to_goal'"),
}


@pytest.mark.parametrize("name", BAD_CURVES)
def test_a_curve_that_is_none_is_refused(name, tmp_path):
    content, message = BAD_CURVES[name]
    path = tmp_path / "curve.csv"
    path.write_text(content)
    with pytest.raises(ValueError, match=re.escape(message)) as error:
        read_curve(path, "curve")
    assert str(path) in str(error.value) and "\n" not in str(error.value)
