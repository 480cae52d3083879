"""What a suite of ground motions does: fragility, response against intensity, gaps that are needed."""

from __future__ import annotations

from textwrap import fill
from typing import Any

import numpy as np
import xarray as xr
from matplotlib.figure import Figure

from pounding_sweep.analysis.comparisons import EVENTS, MOTION_DIMS
from pounding_sweep.analysis.comparisons.fragility import TRIALS, FitStatus, crossed, merged, sentence
from pounding_sweep.analysis.comparisons.suites import NO_FRACTILES, directions
from pounding_sweep.analysis.scenarios import TOUCH_VARIABLES
from pounding_sweep.figures import CONTACT, figure_of
from pounding_sweep.figures.select import (
    choose_response,
    coord_text,
    first_varied,
    is_log,
    labels_with_values,
    law_name,
    record_name,
    result_of,
    select_default,
    select_lines,
    use_logarithms,
    with_dims,
)
from pounding_sweep.figures.style import COLOURS, DASHED, MARKERS, finish, legend_below, put_title, subplots, unit_text

#: Rows of panels of response against intensity at most, and dashes of fractiles.
_LAWS, _DASHES = 3, ("--", "-", "-.", ":") * 3
#: Trials of many intensities are put together into so many classes of about equal size to show their shares.
_CLASSES = 6
#: Characters of a line of a legend.
_ENTRY = 48
#: More records than this are not named below the axis.
_NAMED = 8


def _draw_intensities(ax: Any, result: xr.Dataset) -> str:
    """Make the x of a panel, of intensities, logarithmic if the scales are, else begin at zero; return its label."""
    scales = next((result[dim].values for dim in MOTION_DIMS[1:] if dim in result.dims), np.ones(1))
    if is_log(np.sort(scales)):
        use_logarithms(ax.xaxis)
    else:
        ax.set_xlim(left=0.0)
    attrs = result["intensity"].attrs
    return fill(f"{attrs['long_name']} ({unit_text(attrs) or '-'})", 36)


def _name_records(result: xr.Dataset) -> str:
    """Say which record, or how many, a result is of."""
    if result.sizes.get("record", 1) > 1:
        return f"{result.sizes['record']} records"
    return coord_text(result, "record", result["record"].values.item()) if "record" in result.coords else ""


@figure_of(
    "fragility",
    "cube",
    "probability that a pair touches, against intensity, with its confidence",
    *("pair", CONTACT, f"several {'|'.join(TRIALS)}"),
)
def fragility(cube: xr.Dataset) -> Figure:
    """Draw the probability of an event against intensity.

    One panel per pair or building. Lines are the values of the first axis that varies (gap, stiffness, ...), five at
    most, evenly chosen, or else the laws; of the other axes, and of the laws, the middle value is shown. Bands are
    confidence intervals, between the least and the greatest intensity tried; marks are the shares observed at each
    intensity where trials share them (stripes), else in classes of about equal numbers of trials. The title says where
    curves cross. Where there is no fit, the legend says why.
    """
    from matplotlib.transforms import ScaledTranslation

    result = result_of(cube, "fragility")
    event = EVENTS[result.attrs["event"]]
    spelt = (f" {event.units}", f" {unit_text({'units': event.units})}") if event.units else ("", "")
    words, per = str(result.attrs["event_in_words"]).replace(*spelt), event.per
    result = with_dims(result, *(dim for dim in ("law", per) if dim in result.coords))
    keep = (*TRIALS, "bound", "intensity", "quantile")
    axis = first_varied(result, but=keep) or "law"
    result, shown = select_default(result, (*keep, axis), ["happened"])
    result = with_dims(result, axis, absent="")
    ends, lines = result[per].values.tolist(), select_lines(result, axis)
    figure, axes = subplots(1, len(ends), (1.4 + 3.4 * len(ends), 4.6))
    for ax, end in zip(axes[0], ends, strict=True):
        for place, style, marker in zip(lines, DASHED, MARKERS, strict=False):
            part = result.isel({axis: place}).sel({per: end})
            label = coord_text(part, axis, part[axis].item())
            _draw_fit(ax, part, style, marker, f"{label}: " if label else "")
        ax.set(ylim=(-0.02, 1.02), title=f"{per} {end}")
    label = _draw_intensities(axes[0, 0], result)  # shared: nothing drawn later would move it
    below = ScaledTranslation(0.0, -0.4 - 0.16 * label.count("\n"), figure.dpi_scale_trans)  # of the label
    for ax in axes[0]:
        ax.legend(loc="upper center", bbox_to_anchor=(0.5, 0.0), bbox_transform=ax.transAxes + below, fontsize=8)
    cross = "curves cross, as each has its own dispersion" if crossed(result.isel({axis: lines})) else ""
    one = f"one dispersion along {result.attrs['one_dispersion']}" if "one_dispersion" in result.attrs else ""
    title = words, _name_records(result), shown, cross, one
    finish(figure, axes, label, [f"probability that\n{words} (-)"], *title, legend=0)
    return figure


def _draw_fit(ax: Any, part: xr.Dataset, style: dict[str, Any], marker: str, label: str) -> None:
    """Draw one fit with its band and the observed shares."""
    x, happened = part["trial_intensity"].values.ravel(), part["happened"].values.ravel()
    x, happened = x[np.isfinite(happened)], happened[np.isfinite(happened)]
    mark = {"color": style["color"], "marker": marker, "linestyle": "none"}
    units = part["median"].attrs["units"]
    if int(part["fit_status"]) == FitStatus.FITTED:
        at, band = part["intensity"].values, part["probability_interval"].values
        tried = (at >= x.min()) & (at <= x.max()) & np.isfinite(band).all()
        ax.fill_between(at, *band, where=tried, color=style["color"], alpha=0.15, linewidth=0)
        numbers = float(part["median"]), unit_text({"units": units}), float(part["dispersion"])
        fitted = "{}median {:.3g} {}, dispersion {:.2g}".format(label, *numbers)
        ax.plot(at, part["probability"].values, label=fill(fitted, _ENTRY), **style)
    else:
        why = sentence(part).replace(f" {units}", f" {unit_text({'units': units})}")
        ax.plot([], [], label=fill(label + why, _ENTRY), **mark)
    order = np.argsort(x, kind="stable")  # a mark for trials of one intensity, if several share it, else of a class
    groups = np.split(order, np.flatnonzero(np.diff(merged(x)[order])) + 1) if x.size else []
    groups = groups if groups and min(map(len, groups)) > 1 else np.array_split(order, min(_CLASSES, len(order)) or 1)
    ax.plot(*([values[group].mean() for group in groups if group.size] for values in (x, happened)), **mark)


@figure_of(
    "incremental",
    "cube",
    "response against intensity, record by record, with the fractiles of the suite",
    f"several {'|'.join(MOTION_DIMS[1:])}",
)
def incremental(cube: xr.Dataset) -> Figure:
    """Draw responses against intensity as records are scaled up; of one record its curve alone, without fractiles."""
    name, label, factor, per = choose_response(cube, "incremental")
    touch = next((name for name in TOUCH_VARIABLES if name in cube), name)  # by which the default is selected
    result = with_dims(
        result_of(cube, "incremental", outputs=dict.fromkeys((name, touch))), "law", per, "storey", absent=""
    )
    scaled = next(dim for dim in MOTION_DIMS[1:] if dim in result.dims)
    result, shown = select_default(result, ("law", "record", scaled, "quantile", "level"), [name])
    laws = [law for law in labels_with_values(result, "law", [name]) if per == "building" or law != "none"]
    laws, ends = laws[:_LAWS], labels_with_values(result, per, [name], panels=True)
    ways, suite = directions(result[scaled].values), result.sizes["record"] > 1
    thin = {"color": "0.7", "linewidth": 0.8} if suite else {"color": COLOURS[0]}
    figure, axes = subplots(len(laws), len(ends), (1.6 + 2.6 * len(ends), 1.3 + 2.0 * len(laws)))
    for row, law in zip(axes, laws, strict=True):
        for ax, end in zip(row, ends, strict=True):
            part = result.sel({"law": law, per: end})
            largest = part[name].max(["record", scaled])
            part = part.isel(storey=int(largest.fillna(-np.inf).argmax("storey")))
            for way in ways:
                curves = part.isel({scaled: way}).transpose(scaled, ...)
                dot = "" if len(way) > 1 else "."  # of one scale there is no line
                ax.plot(curves["intensity"], curves[name] * factor, marker=dot, **thin)
            ax.lines[0].set_label("record")
            whole = part[f"{name}_count"] == part.sizes["record"] * len(ways)  # of fewer, a curve would jump
            fractiles = part[f"{name}_fractiles"].where(whole) * factor
            for q, dashes in zip(part["quantile"].values if suite and whole.any() else (), _DASHES, strict=False):
                words, style = f"{q:.0%} fractile", {"color": COLOURS[2], "linestyle": dashes}
                if q == 0.5:
                    words, style = "median", {"color": COLOURS[0]}
                ax.plot(part["level"], fractiles.sel(quantile=q), linewidth=1.8, label=words, **style)
            place = f"{per} {end}, storey {part['storey'].item()}"
            ax.set_title("\n".join(filter(None, (law_name(result, law), place))))
        row[0].set_ylim(bottom=0.0)
    intensity = _draw_intensities(axes[0, 0], result)  # shared by all, as y is by a row
    finish(figure, axes, intensity, [label] * len(laws), _name_records(result), shown, legend=4)
    if suite and NO_FRACTILES in result.attrs:
        units = result["intensity"].attrs
        why = result.attrs[NO_FRACTILES].replace(units["units"], unit_text(units))
        words = fill(f"No fractiles: {why}.", int(12.5 * figure.get_figwidth()))
        figure.suptitle("\n".join(filter(None, (figure.get_suptitle(), words))))
    return figure


@figure_of(
    "gap-for-probability",
    "cube",
    "probability that a pair touches, and its annual rate, against the gap",
    *("pair", "several record"),
)
def gap_for_probability(cube: xr.Dataset) -> Figure:
    """Draw the probability that a pair touches against its gap, and the rate where the result has a hazard.

    One column per pair. Lines are the lognormal of the records' required gaps, bands its confidence intervals of the
    gap, steps the shares of the records; one line for each intensity, else for each scale of the cube, five at most,
    evenly chosen. Below, with a hazard, is the annual rate, and a cross at the row's own gap.
    """
    result = with_dims(result_of(cube, "gap-for-probability"), "pair")
    axis = next((dim for dim in ("intensity", *MOTION_DIMS[1:]) if dim in result.dims), "suite")
    result, shown = select_default(result, ("record", "probability", "curve", axis), ["median"])
    pairs = labels_with_values(result, "pair", ["trial_gap"], panels=True)
    rows = ["probability of touching (-)", *["annual rate of touching (1/year)"] * ("gap_in_years" in result)]
    figure, axes = subplots(len(rows), len(pairs), (1.6 + 3.0 * len(pairs), 0.9 + 2.7 * len(rows)))
    result = with_dims(result, axis, absent="")
    for column, pair in enumerate(pairs):
        ax, whole = axes[0, column], result.sel(pair=pair)
        for place, style in zip(select_lines(result, axis), DASHED, strict=False):
            part = whole.isel({axis: place})
            label = "lognormal" if axis == "suite" else coord_text(part, axis, part[axis].item())
            _draw_gaps(ax, part, "curve_gap", part["curve"].values, style, label)
            gaps = 1e3 * np.sort(part["trial_gap"].dropna("record").values)
            shares = 1.0 - np.arange(gaps.size) / max(gaps.size, 1)
            ax.plot(gaps, shares, color=style["color"], linestyle="none", marker=".", markersize=3)
        ax.set(title=f"pair {pair}", yscale="log", ylim=(1e-3, 1.0))
        if len(rows) > 1:
            ax, part = axes[1, column], whole.isel({axis: 0})
            rate = -np.log1p(-part["curve"].values) / float(part.attrs["years"])
            _draw_gaps(ax, part, "curve_gap_in_years", rate, {"color": COLOURS[0]}, "lognormal")
            observed = 1e3 * part["curve_gap_in_years_observed"]
            ax.plot(observed, rate, color=COLOURS[2], linestyle=":", label="the records")
            if "rate" in part:
                ax.plot(1e3 * part["row_gap"], part["rate"], "kX", label="the row's gap")
            ax.set_yscale("log")
            ax.legend(loc="upper right", fontsize=8)
    axes[0, 0].set_xlim(left=0.0)
    intensity = str(result.attrs.get("intensity", "")).replace("m s-2", "m/s²").replace("m s-1", "m/s")
    said = f"{result.attrs['confidence']:.0%} intervals; dots: shares of the {result.attrs['suite']} records"
    finish(figure, axes, "gap (mm)", rows, f"lognormal with {said}", shown)
    figure.legends[0].set_title(intensity or None, {"size": 9})
    return figure


def _draw_gaps(ax: Any, part: xr.Dataset, name: str, y: np.ndarray, style: dict[str, Any], label: str) -> None:
    """Draw a lognormal with the band of its gaps."""
    low, high = (part[f"{name}_{end}"].values * 1e3 for end in ("lower", "upper"))
    finite = np.isfinite(low) & np.isfinite(high)
    ax.fill_betweenx(y, low, high, where=finite, color=style["color"], alpha=0.15, linewidth=0)
    ax.plot(part[name].values * 1e3, y, label=label, **style)


@figure_of(
    "required-gap",
    "cube",
    "the gap that each pair needs, exactly and by separation rules",
    *("pair", "record|case|exact"),
)
def required_gap(cube: xr.Dataset) -> Figure:
    """Draw the required gap of each pair, record by record, and what separation rules ask for over it.

    One column per pair. Above, the exact required gap (bars) and that of each rule
    (markers), records in the order of the exact one; below, the ratio of each rule to
    it, one dot per record and a bar at the median: below 1 a rule is unsafe.
    """
    result = result_of(cube, "required-gap")
    trials = "case" if "case" in result.dims else "record"
    result, shown = select_default(with_dims(result, trials, absent="-"), (trials, "rule"), ["exact"])
    pairs, rules = labels_with_values(result, "pair", ["exact"], panels=True), result["rule"].values.tolist()
    names = [str(rule).replace("_", " ") for rule in rules]
    figure, axes = subplots(2, len(pairs), (2.0 + 3.2 * len(pairs), 6.2), sharex=False)
    x = np.arange(result.sizes[trials])
    spread = np.linspace(-0.22, 0.22, len(x)) if len(x) > 1 else np.zeros(1)
    tilted: Any = {"rotation": 30, "ha": "right", "rotation_mode": "anchor"}
    for pair, gaps, ratios in zip(pairs, *axes, strict=True):
        part = result.sel(pair=pair).sortby("exact")
        gaps.bar(x, part["exact"].values * 1e3, color="0.8", width=0.8, label="exact", zorder=1)
        ratios.axhline(1.0, color="0.4", linewidth=0.9, zorder=0)
        for number, rule in enumerate(rules):
            hollow = {"markerfacecolor": "none", "markersize": 6} if number % 2 else {}  # one seen through the other
            mark = {"color": COLOURS[1:][number % 7], "marker": MARKERS[number % 8], "linestyle": "none", **hollow}
            ratio = part["ratio"].sel(rule=rule)
            gaps.plot(x, 1e3 * part["rule_gap"].sel(rule=rule), label=names[number], **mark)
            ratios.plot(number + spread, ratio, **mark)
            ratios.plot([number - 0.35, number + 0.35], [ratio.median()] * 2, color="black", linewidth=1.6)
        if len(x) <= _NAMED and trials == "record":
            gaps.set_xticks(x, [fill(record_name(key), 22) for key in part["record"].values.tolist()], **tilted)
        else:
            gaps.set_xlabel(f"{trials}s, by rising required gap")
        ratios.set_xticks(range(len(rules)), names, **tilted)
        gaps.set(title=f"pair {pair}", axisbelow=True)
        for panel in (gaps, ratios):
            panel.grid(visible=False, axis="x")
    axes[0, 0].set_ylim(bottom=0.0)
    for panel, label in zip(axes[:, 0], ("required gap (mm)", "rule over exact (-)"), strict=True):
        panel.set_ylabel(label)
    legend_below(figure, axes[0, 0], most=4)
    put_title(figure, shown)
    return figure
