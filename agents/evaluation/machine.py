"""What hardware a policy runs on, in plain words that follow from the settings of actuators and sensor."""

from __future__ import annotations

import math
from collections.abc import Callable, Mapping, Sequence
from typing import Any, NamedTuple

import numpy as np

from agents.evaluation.words import joined
from vibgym import checks
from vibgym.actuators import ACTUATORS
from vibgym.actuators.prototype import PrototypeActuators
from vibgym.actuators.stage import IdealActuators
from vibgym.config import to_si
from vibgym.plugins.camera import CameraSensor, Settings
from vibgym.plugins.tilting.model import RAMP, RESTITUTION
from vibgym.scene import Surface
from vibgym.sensing import EFFECTS, SENSORS
from vibgym.sensing.effects import deviations
from vibgym.sensing.pose import IdealSensor, PoseSensor
from vibgym.simulation.simulator import MODELS

IDEAL = (
    "Every element does exactly what it is told, at once.",
    "The policy knows exactly where every part is, at once.",
)
"""Said of actuators and a sensor that are ideal."""


class Words(NamedTuple):
    """What one setting means."""

    short: str
    sentence: str


Said = Callable[[Any, Mapping[str, Any], Surface], Words | None]
"""(value, all settings beside it, surface) -> words; None where the setting does nothing."""


def sentences(environment: Mapping[str, Any], surface: Surface) -> list[str]:
    """What an engineer would tell of the machine that these arguments of an environment make, at length."""
    parts = _words(environment, surface)
    actuators, sensor, physics, drawn = ([each.sentence for each in found] for found in parts)
    return [*(actuators or IDEAL[:1]), *(sensor or IDEAL[1:]), *physics, *drawn]


def cards(environments: Mapping[str, Mapping[str, Any]], surface: Surface) -> list[dict[str, Any]]:
    """Name and sentences of every machine, for a page; nothing where all of them are ideal.

    Args:
        environments: name of the machine -> arguments of its environments.
        surface: the table.
    """
    found = {name: sentences(each, surface) for name, each in environments.items()}
    if all(tuple(said) == IDEAL for said in found.values()):
        return []
    return [{"name": name, "sentences": said} for name, said in found.items()]


def summary(environment: Mapping[str, Any], surface: Surface) -> str:
    """The same in a few words."""
    return ", ".join(each.short for found in _words(environment, surface) for each in found) or "ideal"


def settings_of_sensor(settings: Mapping[str, Any], surface: Surface) -> str:
    """What settings that lie over those of any sensor mean."""
    known = EVERY["sensor"]
    said = [words(settings[name], settings, surface) for name, words in known.items() if name in settings]
    plain = ", ".join(f"{name} {value}" for name, value in settings.items() if name not in known)
    return " ".join([*(each.sentence for each in said if each is not None), *([f"({plain})"] if plain else [])])


def _words(environment: Mapping[str, Any], surface: Surface) -> tuple[list[Words], ...]:
    """Of actuators, sensor, physics, and what is drawn for every episode."""
    actuators = _of_kind(environment.get("actuators", "ideal"), "actuators", ACTUATORS, surface)
    sensor = _of_kind(environment.get("sensor", "ideal"), "sensor", SENSORS, surface)
    model, knobs = checks.named("model", environment.get("model", "planar"), MODELS)
    physics = [_rigid(**knobs)] if model == "tilting" else []
    drawn = []
    for name, value in to_si(environment.get("randomize") or {}, "randomize").items():
        if name == "disturbance":
            drawn.append(_struck(to_si(value, name)))
            continue
        text = _range(name, value)
        drawn.append(Words(text, f"Drawn anew for every episode: {text}."))
    return actuators, sensor, physics, drawn


def _rigid(restitution: float = RESTITUTION, ramp_mm: float = 1e3 * RAMP, **steps: int) -> Words:
    """Of ``model="tilting"``."""
    differ = f"restitution {restitution:g}, plates' edges blended over {ramp_mm:g} mm"
    return Words(
        f"rigid parts ({differ})",
        f"Parts are rigid bodies: they rock where plates stand at different heights ({differ}).",
    )


def _struck(setting: Mapping[str, Any]) -> Words:
    """Of ``randomize={"disturbance": ...}``."""
    tilt = setting["tilt"]
    ends = sorted({*tilt} if checks.listed(tilt) else {tilt})
    degrees = " to ".join(f"{math.degrees(each):.4g}" for each in ends)
    often = f"about {60.0 * setting['rate']:.3g} times a minute"
    return Words(f"struck {often}", f"Every part is struck {often}, as hard as a tilt of {degrees}°.")


def _of_kind(given: Any, what: str, kinds: Mapping[str, Any], surface: Surface) -> list[Words]:
    kind, own = (given["kind"], to_si(given, what)) if isinstance(given, Mapping) else (given, {})
    own = {name: value for name, value in own.items() if name != "kind"}
    usual, effects = checks.keywords(kinds[kind]), to_si(own.pop("effects", {}), "effects")
    values = {**usual, **own}
    flat = {name: words for name, words in EFFECT_WORDS.items() if what == "sensor" and name not in usual}
    known = {**WORDS.get(kinds[kind], {}), **flat, **EVERY[what]}
    found = [words(values[name], values, surface) for name, words in known.items() if name in values]
    effects |= {name: value for name, value in own.items() if name in EFFECTS and name not in {**known, **usual}}
    found += [EFFECT_WORDS.get(name, _effect(name))(value, effects, surface) for name, value in effects.items()]
    if kinds[kind] not in WORDS:
        foreign = ", ".join(f"{name} {value}" for name, value in own.items() if name not in known)
        verb, of = "is" if what == "sensor" else "are", f"{kind} ({foreign})" if foreign else kind
        found.insert(0, Words(of, f"The {what} {verb} of kind {of}."))
    return [each for each in found if each is not None]


def _range(name: str, value: Any) -> str:
    """ "friction 90 to 110 %"."""
    factor, unit = UNITS.get(name, (1.0, ""))
    if isinstance(value, int | float):
        value = f"up to {factor * value:.4g}"
    elif all(isinstance(each, int | float) for each in value):
        value = " to ".join(f"{factor * each:.4g}" for each in value)
    return f"{NAMES.get(name, name.replace('_', ' '))} {value}{unit}"


NAMES = {"patches": "friction of each element"}
"""Of what may be drawn, where the setting's own does not say it."""


UNITS = {
    "dead_zone": (1e3, " mm"),
    "limit": (1e3, " mm"),
    "resolution": (1e3, " mm"),
    "latency": (1.0, " periods"),
    "gain_spread": (100.0, " %"),
    "phase_spread": (180.0 / math.pi, "°"),
    "bandwidth": (1.0, " Hz"),
    "dead": (100.0, " %"),
    "stuck": (100.0, " %"),
    "friction": (100.0, " %"),
    "mass": (100.0, " %"),
    "incline": (180.0 / math.pi, "°"),
    "patches": (100.0, " %"),
}
"""Of what may be drawn for every episode: factor and unit in which it is said."""


BELOW = {"hard": "does not move at all", "soft": "moves less than told", "cubic": "moves much less than told"}


def _plainly(short: str, sentence: str, size: Callable[[Any, Surface], str]) -> Said:
    """Words for a setting by its size, which stands for ``{}`` in both of them; none where there is no size to it."""

    def words(value: Any, values: Mapping[str, Any], surface: Surface) -> Words | None:
        nothing = value is None or (isinstance(value, int | float) and value == 0)
        text = "" if nothing else size(value, surface)
        return Words(short.format(text), sentence.format(text)) if text else None

    return words


def _percent(share: float, surface: Surface) -> str:
    return f"{100.0 * share:.3g} %"


def _late(periods: int, surface: Surface) -> str:
    return f"{periods} period{'' if periods == 1 else 's'} ({1e3 * periods * surface.period:g} ms)"


def _dead_zone(width: float, values: Mapping[str, Any], surface: Surface) -> Words | None:
    if not width:
        return None
    form, most = values["dead_zone_form"], 1e3 * (values["limit"] or surface.max_amplitude or 0.0)
    return Words(
        f"{form} dead zone of {1e3 * width:g} mm",
        f"An element that is told to move up and down by less than {1e3 * width:g} mm {BELOW[form]}; "
        f"the most that it can do is {most:.2g} mm.",
    )


def _spread(gain: float, values: Mapping[str, Any], surface: Surface) -> Words | None:
    off = {"amplitude": f"{100.0 * gain:.3g} %"} if gain else {}
    if values["phase_spread"]:
        off["phase"] = f"{math.degrees(values['phase_spread']):.3g}°"
    if not off:
        return None
    anew = "anew in every episode" if values["seed"] is None else "the same in all episodes"
    typical = " and ".join(f"in {what} by {size}" for what, size in off.items())
    return Words(
        f"spread of {' and '.join(off.values())}",
        f"No two elements are alike: each is off {typical} (standard deviation, drawn {anew}).",
    )


def _faulty(short: str, long: str) -> Said:
    def words(value: Any, values: Mapping[str, Any], surface: Surface) -> Words | None:
        if isinstance(value, Sequence):
            some = f"{len(value)} of {surface.rows * surface.columns} elements"
            return Words(f"{some} {short}", f"{some} {long}.") if len(value) else None
        some = f"{100.0 * value:.3g} % of the elements"
        return Words(f"{some} {short}", f"{some}, drawn at random, {long}.") if value else None

    return words


def _off(name: str) -> Callable[[Any, Surface], str]:
    """How far off measurements are, as the setting ``name`` of a sensor says it."""

    def size(value: Any, surface: Surface) -> str:
        position, heading = deviations(name, value, surface.width + surface.depth).tolist()
        found = [f"{1e3 * position:.3g} mm"] if position else []
        return " and ".join([*found, *([f"{math.degrees(heading):.3g}°"] if heading else [])])

    return size


def _effect(name: str) -> Said:
    """Words for an effect of a user's own."""
    return lambda value, values, surface: Words(f"{name} {value}", f"Measurements have the effect {name} ({value}).")


def _camera(statistical: bool, values: Mapping[str, Any], surface: Surface) -> Words:
    if statistical:
        return Words("statistics of a camera", "Measured poses are off as those of a camera are; no images are made.")
    return Words("camera", "A camera above the table measures in its images where every part is.")


def _lines(lines: str, values: Mapping[str, Any], surface: Surface) -> Words:
    columns, rows = values["pixels"]
    if lines == "interlaced":
        late = f"{500.0 * surface.period:g} ms"
        return Words(
            "interlaced lines",
            f"An image of {columns} x {rows} pixels is of two instants: its odd lines are taken {late} before the others.",
        )
    seen = rows // 2 if lines == "half" else rows
    return Words(f"{columns} x {seen} pixels", f"An image has {columns} x {seen} pixels.")


def _edge(edge: str, values: Mapping[str, Any], surface: Surface) -> Words:
    if edge == "threshold":
        return Words("whole pixels", "A pixel belongs to a part or does not; grey levels are not used.")
    return Words("grey-level edges", "Grey levels along the edges tell where they run within a pixel.")


def _other_camera(name: str, said: str, factor: float = 1.0, unit: str = "") -> Said:
    """Words for a setting of the camera that is not as usual."""

    def words(value: Any, values: Mapping[str, Any], surface: Surface) -> Words | None:
        if value == getattr(Settings, name) or value is None:
            return None
        if isinstance(value, Sequence | np.ndarray):
            size = f"{' and '.join(f'{factor * each:.4g}' for each in value)}{unit}"
        else:
            size = f"{factor * value:.4g}{unit}"
        text = said.format(size)
        return Words(text, f"The camera has {text}.")

    return words


ESTIMATORS = {
    "model": Words(
        "model estimator",
        "A model estimator stands between sensor and policy. It simulates what the commands on their way will do, corrects "
        "itself by what is measured, and tells the policy where the part will be when its next command takes effect.",
    ),
    "kalman": Words(
        "Kalman estimator",
        "A Kalman filter stands between sensor and policy: it smooths what is measured, and knows how parts slow down.",
    ),
}


def _estimator(kind: Any, values: Mapping[str, Any], surface: Surface) -> Words | None:
    name = kind["kind"] if isinstance(kind, Mapping) else kind
    if name == "none":
        return None
    own = Words(f"{name} estimator", f"An estimator of kind {name} stands between sensor and policy.")
    return ESTIMATORS.get(name, own)


EVERY: dict[str, dict[str, Said]] = {
    "actuators": {"latency": _plainly("latency of {}", "A command takes effect {} late.", _late)},
    "sensor": {
        "delay": _plainly("measured {} late", "A measurement is {} old when it arrives.", _late),
        "rate": _plainly(
            "{} measurements a second", "There are {} measurements in a second.", lambda hertz, _: f"{hertz:g}"
        ),
        "estimator": _estimator,
        "tell": _plainly(
            "tells {}",
            "Observations also tell {} of what is measured.",
            lambda names, _: joined(names) if names else "",
        ),
    },
}
"""Setting -> what it means, of actuators and sensors of every kind."""

EFFECT_WORDS: dict[str, Said] = {
    "noise": _plainly(
        "noise of {}",
        "Measured poses are off by {} (standard deviation, anew in every measurement).",
        _off("sensor.noise"),
    ),
    "bias": _plainly(
        "bias of {}", "All measurements of an episode share an error of {} (standard deviation).", _off("sensor.bias")
    ),
    "dropout": _plainly("{} of measurements missing", "{} of the measurements are missing.", _percent),
}
"""The same, of the effects that every sensor has where it has no setting of that name itself."""

WORDS: dict[Any, dict[str, Said]] = {
    IdealActuators: {},
    PrototypeActuators: {
        "dead_zone": _dead_zone,
        "limit": _plainly("at most {}", "No element moves by more than {}.", lambda most, _: f"{1e3 * most:.3g} mm"),
        "gain_spread": _spread,
        "bandwidth": _plainly(
            "lag ({})", "Elements follow commands with a lag (first order, {}).", lambda hertz, _: f"{hertz:g} Hz"
        ),
        "resolution": _plainly(
            "steps of {}", "Elements can only do multiples of {}.", lambda step, _: f"{1e6 * step:g} µm"
        ),
        "dead": _faulty("dead", "can never move"),
        "stuck": _faulty("stuck", "can only move in a way of their own"),
    },
    IdealSensor: {},
    PoseSensor: {"noise": EFFECT_WORDS["noise"]},
    CameraSensor: {
        "statistical": _camera,
        "lines": _lines,
        "edge": _edge,
        "height": _other_camera("height", "a height of {}", unit=" m"),
        "position": _other_camera("position", "its place above {}", unit=" m"),
        "tilt": _other_camera("tilt", "a tilt of {}", 180.0 / math.pi, "°"),
        "lens": _other_camera("lens", "a focal length of {}", 1e3, " mm"),
        "chip": _other_camera("chip", "a chip {} wide", 1e3, " mm"),
        "distortion": _other_camera("distortion", "a distortion of {}", 100.0, " %"),
        "blur": _other_camera("blur", "a blur of {}", unit=" pixels"),
        "noise": _other_camera("noise", "a noise of {}", unit=" grey levels"),
        "light": _other_camera("light", "corners darker by {}", 100.0, " %"),
        "threshold": _other_camera("threshold", "its threshold at grey level {}"),
        "border": _other_camera("border", "a border of {} in view", 1e3, " mm"),
        "tetragons": _other_camera("tetragons", "a calibration by {} tetragons"),
        "mark": _other_camera("mark", "calibration marks of {}", 1e3, " mm"),
    },
}
"""The same, of those kinds alone: another kind may mean something else by the same name."""
