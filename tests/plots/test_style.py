"""The look that all figures share."""

from matplotlib.figure import Figure
from matplotlib.text import Text

from vdmsi_jax.plots.style import framed, styled


def test_a_name_with_dollars_is_a_name_wherever_it_stands():
    names: list[Text] = []

    @styled
    def named() -> Figure:
        figure = framed(3.0, 1, 2)
        one, other = figure.subplots(1, 2)
        one.plot([0.0, 1.0], [0.01, 10.0], label="cost $a$")
        one.set_yscale("log")
        names.extend(one.legend().get_texts())
        names.append(one.set_xlabel("$x$ of $y$"))
        names.append(one.set_title("$run$"))
        other.set_yticks([0.0, 1.0], ["$first$", "second"])
        names.append(figure.text(0.5, 0.5, "$said$"))
        return figure

    figure = named()
    assert len(figure.axes[0].xaxis.majorTicks) < 2  # which take long, and hold numbers
    one, other = figure.axes
    for text in [*names, other.get_yticklabels()[0]]:
        assert "$" in text.get_text() and not text.get_parse_math(), text
    figure.canvas.draw()
    powers = [text for text in one.get_yticklabels() if text.get_text()]
    assert powers and all(text.get_parse_math() for text in powers)
