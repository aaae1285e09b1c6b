"""The thesis's sensor figures: what they must show, and the page."""

import pytest

from agents.__main__ import main
from agents.replicate.quantisation import centre_errors, chain_errors


@pytest.mark.parametrize("diameter, most", [(2, 0.17), (10, 0.08), (40, 0.035)])
def test_the_error_of_a_discs_centroid(diameter, most):
    """Fig. 5.8: no bias, and a deviation that both readings of a pixel's membership keep below these."""
    for errors in (centre_errors(diameter, 10_000), chain_errors(diameter, 10_000)):
        assert 0.7 * most < errors.std() < most
        assert abs(errors.mean(axis=0)).max() < 5.0 * errors.std() / 100.0
    assert chain_errors(diameter, 1000, grey=True).std() < 0.1 * most


def test_the_page(tmp_path, capsys):
    assert main(["replicate", "--output", str(tmp_path), "--figure", "camera_chain"]) == 0
    page = (tmp_path / "replicate.html").read_text()
    assert page.count("data:image/png;base64,") == 5 and "Figs. 5.5 to 5.9" in page and "Fig. 5.8" not in page
    assert "http" not in page  # opens offline
    assert str(tmp_path) in capsys.readouterr().out


def test_an_unknown_figure_is_refused(tmp_path, capsys):
    assert main(["replicate", "--output", str(tmp_path), "--figure", "nine"]) == 2
    assert capsys.readouterr().err.startswith("figure: got 'nine'; allowed: 'centroid_error', 'camera_chain'")
    assert not list(tmp_path.iterdir())
