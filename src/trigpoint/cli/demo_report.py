"""The page of the demonstration."""

from __future__ import annotations

import numpy as np

from trigpoint.analysis import gain_bound, worst_case_gain
from trigpoint.cli.demo_story import TENTH_OF_A_MILLIMETRE, Story, observer_lines
from trigpoint.report import Figure, Page, Section, Table, error_figure, network_figure


def demo_page(story: Story) -> Page:
    """One page: the network, the gain, the heights, the observer."""
    graph = story.network.graph
    sections = (_network(story), _gain(story), _heights(story), _observer(story))
    subtitle = f"{graph.n_nodes} marks, {graph.n_arcs} measurements, {int(graph.is_external.sum())} of them absolute"
    return Page("A levelling network, known by its own marks", subtitle, sections)


def _network(story: Story) -> Section:
    marks = [k for k in range(story.network.graph.n_nodes) if story.answer.sigma[k] == 0.0]
    sigma = np.where(story.answer.sigma > 0, 1e3 * story.answer.sigma, np.nan)
    drawing = network_figure(
        story.network.graph, story.network.positions, sigma, label="standard deviation [mm]", known=marks
    )
    caption = "Marks coloured by the standard deviation of their height; triangles are the known marks."
    return Section("The network", " ".join(story.network.title.splitlines()), (Figure(drawing, caption),))


def _gain(story: Story) -> Section:
    bound, graph = story.bound, story.network.graph
    rows = (
        ("smallest eigenvalue of the generalized Laplacian, unit weights", f"{bound.value:.12g}"),
        ("rigorous lower bound", f"{bound.lower:.15g}"),
        ("rigorous upper bound", f"{bound.upper:.15g}"),
        ("gain bound 1/lambda_min", f"{gain_bound(bound):.10g}"),
        (f"worst case over all networks of {graph.n_nodes} nodes", f"{worst_case_gain(graph.n_nodes):.10g}"),
    )
    text = (
        "Every mark has a path to a known height, so every height can be known (G16, Theorem 3). The smallest "
        "eigenvalue says which coupling gain suffices (G16, Theorem 4); the worst case needs no knowledge of the "
        "network beyond its size (Theorem 7)."
    )
    return Section("Can it be known, and with which gain?", text, (Table(("quantity", "value"), rows),))


def _heights(story: Story) -> Section:
    rows = [
        (
            name,
            f"{height:.6f}",
            f"{1e3 * sigma:.4f}" if sigma > 0 else "known",
            f"{story.published[name][0]:.6f}" if name in story.published else "",
            f"{1e3 * story.published[name][1]:.4f}" if name in story.published else "",
        )
        for name, height, sigma in zip(story.answer.names, story.answer.x, story.answer.sigma, strict=True)
    ]
    columns = ("mark", "height [m]", "sigma [mm]", "published [m]", "published sigma [mm]")
    text = (
        f"Weighted least squares with {story.answer.degrees_of_freedom} degrees of freedom; a-posteriori m0 "
        f"{np.sqrt(story.answer.variance_factor or 0.0):.6f}. Largest difference to the published heights: "
        f"{story.largest_difference:.1e} m."
    )
    return Section("The heights", text, (Table(columns, rows, align=("left", *["right"] * 4)),))


def _observer(story: Story) -> Section:
    run = story.run
    norm = run.error_norm
    marks = [
        (time, level, label)
        for level, label in ((0.01 * float(norm[0]), "1 %"), (TENTH_OF_A_MILLIMETRE, "0.1 mm"))
        if (time := run.time_to(level)) is not None
    ]
    drawing = error_figure(run.times, norm, rate=story.observer.decay_rate, unit="m", marks=marks)
    caption = "Distance of all marks from the least-squares heights. Every mark starts at height 0."
    text = (
        "Each mark runs its own estimator and hears its neighbours only. Known marks announce their height and "
        "estimate nothing, so that their arcs become absolute readings of the marks they were levelled to."
    )
    return Section("The observer", text, (Figure(drawing, caption), Table(("what", "result"), observer_lines(story))))
