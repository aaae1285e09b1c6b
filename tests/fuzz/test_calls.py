"""Bad arguments of public functions: they work, or one ValueError names the argument and nothing has changed."""

import copy
import functools
import math
import re
from decimal import Decimal
from fractions import Fraction
from typing import Any

import gymnasium as gym
import numpy as np
from hypothesis import given
from hypothesis import strategies as st

from tests.envs.helpers import assert_same
from tests.fuzz.campaign import count, fuzz, numpy_warns_of_nothing, places  # noqa: F401 - for this module
from vibgym import Part, Simulator, Surface, checks, fields
from vibgym.actuators import ACTUATORS
from vibgym.allocation.frictional import FrictionalInverse
from vibgym.bounds import TimeBound
from vibgym.envs.randomization import Randomization
from vibgym.scene.parts import part_from
from vibgym.scene.surface import surface_from
from vibgym.sensing import ESTIMATORS, SENSORS
from vibgym.tasks.follow import DrawnSettings
from vibgym.tasks.paths import SHAPES as PATHS


class Mute:
    """Object that raises on every access."""

    def __repr__(self):
        raise RuntimeError("no repr")


def recursive():
    """A list that contains itself."""
    result: list[Any] = [1.0]
    result.append(result)
    return result


# Whole numbers are small or absurd: values in between may legitimately take hours.
NUMBERS = st.one_of(
    st.integers(-3, 3),
    st.sampled_from([2**63, -(2**63), 10**18, 10**400, -(10**400)]),
    st.floats(),
    st.sampled_from([0.1, -0.1, 5e-324, 1e300]),
    st.sampled_from([np.float32(0.5), np.int64(2), np.uint8(1), np.bool_(True), np.float64("nan"), np.int64(-(2**63))]),
    st.sampled_from([Fraction(10**400), Fraction(1, 3), Decimal("0.1"), 1j]),
)
TEXTS = ["", "x", "auto", "\ud800", "a\nb", "$\\frac$", "\0", "x" * 5000]
ODD = st.sampled_from([None, True, False, *TEXTS, b"x", object, range(3), recursive(), {1, 2}])
ARRAYS = st.sampled_from([
    np.zeros(0), np.zeros(3), np.full((2, 3), np.nan), np.array("x"), np.array([None, 1]), np.zeros((1,) * 30),
    np.ones(3, bool), np.array([2**63], np.uint64),
])  # fmt: skip
VALUES = st.recursive(
    NUMBERS | ODD | ARRAYS | st.text(max_size=4),
    lambda inner: (
        st.lists(inner, max_size=3)
        | st.dictionaries(st.text(max_size=3) | st.sampled_from(["kind", "shape", "parts", 1]), inner, max_size=2)
        | st.tuples(inner, inner)
    ),
    max_leaves=5,
)

DEEP = functools.reduce(lambda deep, _: [deep], range(2000), [])
UNSPEAKABLE = {"a number of 5000 digits": 10**5000, "no repr": Mute(), "deep": DEEP}
"""Values that hypothesis cannot print, by name."""
VALUES |= st.sampled_from(list(UNSPEAKABLE))


def meant(value):
    """Return the value of a name."""
    return UNSPEAKABLE.get(value, value) if isinstance(value, str) else value


PATH = {"centre": [0.4, 0.1], "radius": 0.04, "side": 0.1, "points": [[0.2, 0.1], [0.4, 0.12]]}
"""Settings of paths that have no default."""

SURFACE, PART = Surface(4, 6), Part.rectangle(0.03, 0.02, friction=0.5)
DISC = {"shape": "disc", "radius": 0.01, "friction": 0.5}
BOUND_OF_TIME = TimeBound(SURFACE, PART, position_tolerance=2e-3)


def made_with(task, argument, form=dict, **fixed):
    """Return a function that makes an environment with settings in one of its arguments."""
    return lambda **settings: gym.make(f"vibgym/{task}-v0", **{argument: form(**fixed, **settings)})


def each_setting(model, **required):
    """Return good values of all settings of a class."""
    defaults = {name: field.get_default() for name, field in model.model_fields.items() if not field.is_required()}
    return {**defaults, **required}


REGISTERED = {
    **{f"actuators {name}": (made_with("Align", "actuators", kind=name), each_setting(item.Settings))
       for name, item in ACTUATORS.items()},
    **{f"sensor {name}": (made_with("Align", "sensor", kind=name), each_setting(item.Settings))
       for name, item in SENSORS.items()},
    **{f"estimator {name}": (
        made_with("Align", "sensor", lambda **settings: {"kind": "pose", "estimator": settings}, kind=name),
        each_setting(item.Settings),
    ) for name, item in ESTIMATORS.items()},
    **{f"path {name}": (
        made_with("Follow", "paths", lambda **settings: [settings], shape=name),
        each_setting(PATHS[name], **{key: value for key, value in PATH.items() if key in PATHS[name].model_fields}),
    ) for name in PATHS},
    "paths drawn": (made_with("Follow", "paths"), each_setting(DrawnSettings)),
    "randomize": (made_with("Sort", "randomize"), dict.fromkeys(Randomization.Settings.model_fields)),
    "disturbance": (
        made_with("Align", "randomize", lambda **settings: {"disturbance": settings}), dict(rate=1.0, tilt=[0.02, 0.04]),
    ),
}  # fmt: skip
CALLS = {
    "Surface": (
        Surface,
        dict(rows=2, columns=2, element_size=0.03, horizontal_amplitude=2e-3, frequency=25.0, gravity=9.81, max_amplitude=1e-4),
    ),
    "rectangle": (
        Part.rectangle,
        dict(length=0.05, width=0.04, friction=0.5, static_friction=0.6, height=0.01, mass=0.1, name="a", restitution=0.2,
             contact_friction=0.3, centre_height=0.004, coupling=0.9),
    ),
    "disc": (Part.disc, dict(radius=0.02, friction=0.5)),
    "polygon": (Part.polygon, dict(vertices=[[0, 0], [0.05, 0], [0, 0.04]], friction=0.5)),
    "Simulator": (
        Simulator,
        dict(surface=SURFACE, parts=PART, walls=["left"], worlds=2, model="planar", threads=1, steps=5, substeps=4, pieces=2,
             contact_steps=10, contact_overlap=5e-6),
    ),
    "tilting": (Simulator, dict(surface=SURFACE, parts=PART, model="tilting", restitution=0.3, ramp_mm=2.0, steps=100)),
    "tip": (
        lambda **settings: Simulator(SURFACE, PART, worlds=2, model="tilting").tip(**settings),
        dict(worlds=[0, 1], lean=0.02, rocking=0.1, which=True),
    ),
    "averaged": (Simulator, dict(surface=SURFACE, parts=PART, model="averaged", order=2, stride=1, steps=1)),
    "auto": (Simulator, dict(surface=SURFACE, parts=PART, model="auto", tolerance=1e-3, periods_per_call=2)),
    "make": (
        functools.partial(gym.make, "vibgym/Sort-v0", surface={"rows": 8, "columns": 32}),
        dict(parts=["steel_block", DISC], model="planar", action="field", observation="state", actuators="ideal",
             sensor="ideal", randomize=None, walls=["left"], start="scattered", zones=None, slots=40, task_settings=None,
             periods_per_step=1, max_episode_periods=10),
    ),
    "make_vec": (
        functools.partial(gym.make_vec, "vibgym/Rotate-v0"),
        dict(num_envs=2, surface={"rows": 8}, parts=["steel_block"], model="averaged", action="patch", observation="goal",
             actuators={"kind": "ideal"}, sensor={"kind": "ideal"}, randomize=None,
             max_episode_periods=10, max_episode_steps=10, autoreset_mode="NextStep"),
    ),
    "surface_from": (surface_from, dict(value="prototype")),
    "part_from": (part_from, dict(value=DISC)),
    "frictional inverse": (FrictionalInverse, dict(surface=SURFACE, parts=[PART], limit=1e-4, ahead=0.02)),
    "time bound": (
        lambda **settings: TimeBound(SURFACE, PART, **settings),
        dict(position_tolerance=2e-3, heading_tolerance=math.inf, heading_period=0.0, hold=10, periods_per_step=1,
             amplitude=1e-4, latency=1),
    ),
    "states of the bound": (BOUND_OF_TIME.steps, dict(start=[0.08, 0.05, 0.0], goal=[0.1, 0.05, 0.0])),
    "uniform": (fields.uniform, dict(direction=0.0, strength=1.0)),
    "squeeze": (fields.squeeze, dict(x=0.1, y=0.1, angle=0.0, strength=1.0, reach=0.03)),
    "radial": (fields.radial, dict(x=0.1, y=0.1, strength=1.0, reach=0.03)),
    "tangential": (fields.tangential, dict(x=0.1, y=0.1, strength=1.0, reach=0.03)),
    "around": (fields.uniform(0.0).around, dict(x=0.1, y=0.1, radius=0.1)),
    "drive": (fields.uniform(0.0).drive, dict(surface=SURFACE, friction=0.5)),
    "lead_angle": (fields.lead_angle, dict(surface=SURFACE, friction=0.5)),
    "slides_permanently": (SURFACE.slides_permanently, dict(friction=0.5)),
    "idle_velocity": (SURFACE.idle_velocity, dict(friction=0.5)),
}  # fmt: skip
CALLS |= REGISTERED
EVERY = [(name, argument) for name, (_, base) in CALLS.items() for argument in base]


def refused(error, *arguments):
    """Assert one short printable line that names the argument, or one that conflicts with it."""
    text = str(error)
    assert re.match(r"[^\n]+", text), text
    named = text.split("; allowed")[0]
    assert not arguments or any(arg in named for arg in arguments), (arguments, text)
    assert text.isprintable() and len(text) < 3000, text
    text.encode()
    count("refused")


@fuzz(examples=75, seconds_share=1.0)
@given(st.sampled_from(EVERY), VALUES)
def test_constructors_and_functions(which, value):
    name, argument = which
    function, base = CALLS[name]
    try:
        made = function(**{**base, argument: meant(value)})
    except ValueError as error:
        refused(error, *((*base, "paths") if "value" not in base else ()))
        return
    count("accepted")
    if isinstance(made, gym.Env | gym.vector.VectorEnv):
        made.close()


def test_every_argument_with_extreme_values():
    """Try each argument of the table with values that once caused a traceback."""
    odd = [None, np.zeros(3), recursive(), {}, {1: 2}, "\ud800", Mute(), DEEP, [[1]], [0, 0]]
    worst = [*odd, 10**400, 10**5000, Fraction(10**400), [10**400], math.nan, 2**63]
    for k, (name, argument) in enumerate(EVERY):
        function, base = CALLS[name]
        for value in worst[k % 4 :: 4]:
            try:
                function(**{**base, argument: value})
            except ValueError as error:
                refused(error, *((*base, "paths") if "value" not in base else ()))


MACHINE = {
    "actuators": {"kind": "prototype", "latency": 2},
    "sensor": {"kind": "pose", "dropout": 0.2, "estimator": "model"},
    "randomize": {"friction": [0.9, 1.1], "dead_zone": [0.0, 1e-4]},
}


@functools.cache
def live(kind):
    """An environment or a simulator that has begun."""
    if kind == "simulator":
        made: Any = Simulator(SURFACE, [PART, PART], walls=["left"], worlds=2)
        made.reset([[0.05, 0.05, 0.0], [0.1, 0.05, 0.0]])
        return made
    if kind == "single":
        made = gym.make("vibgym/Sort-v0", action="field", **MACHINE)
        made.reset(seed=1)
        return made
    if kind == "camera":
        sensor = {"kind": "camera", "lines": "interlaced", "delay": 1, "rate": 12.5, "estimator": "model"}
        made = gym.make("vibgym/Align-v0", action="field", sensor=sensor, observation="camera")
        made.reset(seed=1)
        return made
    made = gym.make_vec("vibgym/Rotate-v0", num_envs=2, action="patch")
    made.reset(seed=1)
    return made


def state_of(made):
    """Return all state that a refused call must not change."""
    return made.get_state() if isinstance(made, Simulator) else made.unwrapped.get_state()


@functools.cache
def beginning(kind):
    """The snapshot that every example starts from."""
    return state_of(live(kind))


METHODS = {
    "simulator": [("reset", "pose", {}), ("reset", "velocity", {"pose": [[0.05, 0.05, 0.0], [0.1, 0.05, 0.0]]}),
                  ("advance", "amplitude", {"phase": 0.0}), ("advance", "phase", {"amplitude": 0.0}),
                  ("advance", "periods", {"amplitude": 0.0, "phase": 0.0}), ("set_state", "state", {})],
    "single": [("reset", "seed", {}), ("reset", "options", {}), ("step", "action", {}), ("set_state", "state", {}),
               ("phasors", "world", {}), ("caption", "world", {})],
    "camera": [("reset", "options", {}), ("step", "action", {}), ("set_state", "state", {})],
    "vector": [("reset", "seed", {}), ("reset", "options", {}), ("step", "actions", {}), ("set_state", "state", {}),
               ("phasors", "world", {}), ("caption", "world", {}), ("get_attr", "name", {}), ("call", "name", {})],
}  # fmt: skip
BOUND = [(kind, *method) for kind, methods in METHODS.items() for method in methods]
OPTIONS = st.dictionaries(st.sampled_from(["pose", "goal", "parts", "reset_mask", "x"]), VALUES, max_size=2)


def call(kind, name, argument, rest, value):
    """A method that is refused changes nothing."""
    made, before = live(kind), beginning(kind)
    target = made if name in ("reset", "step", "advance", "set_state") and hasattr(made, name) else made.unwrapped
    try:
        getattr(target, name)(**{**rest, argument: meant(value)})
    except ValueError as error:
        refused(error, argument.removesuffix("s"))
        assert_same(state_of(made), before)
        return
    count("accepted")
    if isinstance(made, gym.Env):
        made.reset(seed=1)  # Gymnasium's wrappers count steps too
    (made if isinstance(made, Simulator) else made.unwrapped).set_state(before)


@fuzz(examples=75, seconds_share=1.0)
@given(st.sampled_from(BOUND), VALUES, OPTIONS)
def test_methods(which, value, options):
    kind, name, argument, rest = which
    call(kind, name, argument, rest, options if argument == "options" and isinstance(value, dict) else value)


@fuzz(examples=50, seconds_share=1.0)
@given(st.sampled_from(list(METHODS)), st.data(), VALUES | st.sampled_from(["without", "more"]))
def test_damaged_snapshots(kind, data, value):
    state = copy.deepcopy(beginning(kind))
    *above, last = data.draw(st.sampled_from(list(places(state))))
    owner = state
    for key in above:
        owner = owner[key]
    if isinstance(value, str) and value == "without":
        del owner[last]
    elif isinstance(value, str) and value == "more" and isinstance(owner, dict):
        owner["more"] = 1
    elif isinstance(owner[last], np.ndarray) and owner[last].size and isinstance(value, int | float | np.generic):
        owner[last] = owner[last].astype(object if isinstance(value, int) else np.float64)
        owner[last].flat[data.draw(st.integers(0, owner[last].size - 1))] = value
    else:
        owner[last] = meant(value)
    call(kind, "set_state", "state", {}, state)


def test_numbers_of_numpy_are_numbers():
    for kind in (np.float16, np.float32, np.float64, np.longdouble, np.int8, np.int64, np.uint64):
        assert checks.number("x", kind(1)) == 1.0
    for kind in (np.int8, np.int64, np.uint64):
        assert checks.count("x", kind(1)) == 1
    assert Surface(np.int32(3), np.uint8(4), np.float32(0.03)).columns == 4
    assert Simulator(SURFACE, PART, worlds=np.int64(2)).worlds == 2
