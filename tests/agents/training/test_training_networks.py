"""Networks: NumPy against torch, attention over neighbours."""

import copy

import numpy as np
import pytest
import torch

from agents.networks import NETWORKS, Attention, PartsCritic, Tanh, elements_about, trained_tensors
from vibgym.policies.trained.networks import ACTING, Shape, offsets

ACTORS = {kind: NETWORKS[kind][0] for kind in ("parts", "elements")}
"""Networks that read rows; test_trained_pictures.py tests networks of pixels."""

OWN, WIDTH, PLACE = 9, 4, 3
NUMBERS, SIDE = 6, 5


def shape_of(kind, neighbours):
    numbers, side = (NUMBERS, 0) if kind == "parts" else (2 * SIDE**2, SIDE)
    return Shape(OWN + neighbours * WIDTH, neighbours, WIDTH, numbers, side, PLACE)


def actor_of(kind, neighbours, activation="tanh"):
    """Far from its beginning, where log std hits its bounds, too."""
    torch.manual_seed(1)
    actor = ACTORS[kind](shape_of(kind, neighbours), [12, 7], activation, 8, -0.5)
    with torch.no_grad():
        for parameter in actor.parameters():
            parameter.add_(0.5 * torch.randn_like(parameter))
        actor.log_std.weight.mul_(4.0)
    return actor


def rows_of(neighbours, there=None, lead=(3, 6), seed=0):
    """Rows with ``neighbours`` neighbours, present where ``there`` (neighbours,) is 1; absent ones are zeros."""
    rows = np.random.default_rng(seed).uniform(-1, 1, (*lead, OWN + neighbours * WIDTH)).astype(np.float32)
    if neighbours:
        blocks = rows[..., OWN:].reshape(*lead, neighbours, WIDTH)
        there = np.ones(neighbours) if there is None else np.asarray(there)
        blocks[..., 0] = 1.0
        rows[..., OWN:] = (blocks * there[:, None]).reshape(*lead, -1)
    return rows


def by_torch(module, *arrays):
    with torch.no_grad():
        return module(*(torch.from_numpy(array) for array in arrays))


@pytest.mark.parametrize("activation", ["tanh", "relu"])
@pytest.mark.parametrize("there", [None, [1, 1, 1], [1, 0, 1], [0, 0, 0]])
@pytest.mark.parametrize("kind", ACTORS)
def test_numpy_acts_as_torch_does(kind, there, activation):
    neighbours = 0 if there is None else len(there)
    actor = actor_of(kind, neighbours, activation)
    rows = rows_of(neighbours, there)
    with torch.no_grad():  # standard deviations about the middle of what is allowed, some beyond either bound
        log_std = actor.log_std(actor.hidden(actor.eyes(torch.from_numpy(rows)))).flatten(0, -2)
        scale = 2.5 / log_std.std(dim=0)
        actor.log_std.bias.copy_((actor.log_std.bias - log_std.mean(dim=0)) * scale - 2.25)
        actor.log_std.weight.mul_(scale[:, None])
    expected = [output.numpy() for output in by_torch(actor, rows)]
    got = ACTING[kind](trained_tensors(actor), shape_of(kind, neighbours), activation, rows)
    for mine, theirs in zip(got, expected, strict=True):
        assert mine.dtype == np.float32 and mine.shape == theirs.shape == (3, 6, shape_of(kind, neighbours).action)
        assert np.abs(mine - theirs).max() < 1e-5 * max(1.0, np.abs(theirs).max())
    assert np.ptp(expected[0]) > 0.1 and expected[1].min() >= -5.0 and expected[1].max() <= 0.5
    assert len(np.unique(expected[1])) > 3  # exploration depends on what is seen


def test_exploration_grows_with_actions_above_its_floor():
    """In torch and NumPy: ten times the action, ten times the standard deviation; never less than the floor's share."""
    torch.manual_seed(1)
    actor = ACTORS["parts"](shape_of("parts", 0), [12], "relu", 8, -2.0, 1e-6)
    rows = rows_of(0)
    spreads = []
    for factor in (0.05, 0.5):
        with torch.no_grad():
            actor.mean.weight.normal_(generator=torch.Generator().manual_seed(0)).mul_(0.1 * factor)
        mean, log_std = (output.numpy() for output in by_torch(actor, rows))
        got = ACTING["parts"](trained_tensors(actor), shape_of("parts", 0), "relu", rows)
        assert all(np.abs(mine - theirs).max() < 1e-5 for mine, theirs in zip(got, (mean, log_std), strict=True))
        assert np.abs(mean).max() < 1.0
        spreads.append(np.exp(log_std))
    assert np.allclose(spreads[1] / spreads[0], 10.0, rtol=1e-3)
    with torch.no_grad():
        actor.mean.weight.zero_(), actor.log_std_floor.fill_(0.25)
    assert np.allclose(np.exp(by_torch(actor, rows)[1].numpy()), 0.25 * np.exp(-2.0), rtol=0.2)


@pytest.mark.parametrize("there", [[1, 1, 1, 1, 1], [1, 0, 1, 0, 0], [0, 0, 0, 0, 0]])
def test_attention_is_that_of_keys_and_queries(there):
    """By its definition, key by key and in float64; so are all gradients, and the keys' bias has none.

    The values of absent neighbours have no effect; without neighbours the result is zero.
    """
    torch.manual_seed(2)
    attention = Attention(OWN, WIDTH, 8)
    for parameter in attention.parameters():
        torch.nn.init.normal_(parameter, std=0.7)
    values = rows_of(len(there), there)
    blocks = values[..., OWN:].reshape(3, 6, len(there), WIDTH)
    blocks[..., np.array(there) == 0, 1:] = 50.0
    rows = torch.from_numpy(np.concatenate([values[..., :OWN], blocks.reshape(3, 6, -1)], axis=-1))
    own, others = rows[..., :OWN].clone().requires_grad_(), rows[..., OWN:].unflatten(-1, (len(there), WIDTH))
    gradient = torch.randn(3, 6, 8)
    (attention(own, others) * gradient).sum().backward()
    mine = {name: parameter.grad for name, parameter in attention.named_parameters()} | {"own": own.grad}
    plain, seen = copy.deepcopy(attention).double(), rows[..., :OWN].double().requires_grad_()
    code = torch.relu(plain.encode(others.double()))
    logit = torch.einsum("...kc,...c->...k", plain.key(code), plain.query(seen)) / 8**0.5
    share = torch.softmax(logit.masked_fill(torch.tensor(there) < 0.5, -torch.inf), dim=-1).nan_to_num()
    mean = torch.einsum("...k,...kc->...c", share, code) if any(there) else 0.0 * code.sum(dim=-2)
    assert torch.allclose(attention(own, others).double(), mean, atol=1e-5)
    plain.zero_grad()
    (mean * gradient).sum().backward()
    assert mine.pop("key.bias") is None
    gradients = {name: weights.grad for name, weights in plain.named_parameters()} | {"own": seen.grad}
    bias = gradients.pop("key.bias")
    assert bias is None or bias.abs().max() < 1e-12
    for name, theirs in gradients.items():
        expected = torch.zeros(()) if theirs is None else theirs
        assert torch.allclose(mine[name].double(), expected.double(), atol=1e-4 * max(1.0, expected.abs().max())), name


def test_tangents_and_their_gradients():
    """Right to 2e-7, also at infinity; what is not a number stays so."""
    x = (8.0 * torch.randn(9000, generator=torch.Generator().manual_seed(0))).requires_grad_()
    y = Tanh()(x)
    assert (y.double() - torch.tanh(x.double())).abs().max() < 2e-7
    assert torch.allclose(torch.autograd.grad(y.sum(), x)[0], 1.0 - torch.tanh(x) ** 2, atol=1e-6)
    assert Tanh()(torch.tensor([torch.inf, -torch.inf, 0.0])).tolist() == [1.0, -1.0, 0.0]
    assert Tanh()(torch.tensor([torch.nan])).isnan().all()


def test_the_critic_sees_the_parts_that_are_there_in_any_order():
    torch.manual_seed(1)
    critic = PartsCritic(shape_of("parts", 3), [12], "tanh", 8)
    rows, mask = rows_of(3), np.ones((3, 6), dtype=np.float32)
    mask[:, 4:] = 0.0
    value = by_torch(critic, rows, mask)
    order = [3, 1, 0, 2, 5, 4]
    assert torch.allclose(by_torch(critic, rows[:, order], mask[:, order]), value[:, order], atol=1e-6)
    other = rows.copy()
    other[:, 4:] = 0.3  # what is not there is not seen
    assert torch.equal(by_torch(critic, other, mask)[:, :4], value[:, :4])
    other = rows.copy()
    other[:, 3] *= -1.0  # what is, is: by all
    assert ((by_torch(critic, other, mask) - value)[:, :3].abs() > 1e-6).all()


@pytest.mark.parametrize("side", [4, 5])
def test_elements_lie_where_the_patch_has_them(side):
    """Centres minus the part's, in elements: the patch covers the part evenly, wherever it lies in its element."""
    place = np.random.default_rng(0).uniform(-1, 1, (50, 2)).astype(np.float32)
    about = offsets(place, side)  # (50, side, 2)
    within = 0.5 * (place[:, None] + 1.0)
    fraction = (about + within - 0.5) % 1.0  # counted from the part's element: whole steps
    assert np.minimum(fraction, 1.0 - fraction).max() < 1e-5
    assert np.allclose(np.diff(about, axis=1), 1.0) and np.abs(about).max() <= 0.5 * side + 1e-5
    of_torch = elements_about(torch.from_numpy(place), side).numpy().reshape(50, side, side, 4)
    assert np.allclose(of_torch[..., 0], about[:, None, :, 0]) and np.allclose(of_torch[..., 1], about[:, :, None, 1])
    assert np.allclose(of_torch[..., 2:], of_torch[..., :2] ** 2)


def test_the_element_network_is_the_same_function_on_patches_of_any_size():
    """The same tensors give an element the same phasor, whether its patch is small or large."""
    actor, rows = actor_of("elements", 0), rows_of(0)
    tensors, shape = trained_tensors(actor), shape_of("elements", 0)
    small = ACTING["elements"](tensors, shape, "tanh", rows)[0].reshape(3, 6, SIDE, SIDE, 2)
    large = ACTING["elements"](tensors, shape._replace(side=SIDE + 2), "tanh", rows)[0]
    large = large.reshape(3, 6, SIDE + 2, SIDE + 2, 2)
    assert np.allclose(small, large[:, :, 1:-1, 1:-1], atol=1e-6)
