"use strict";
// Charts over a common time: zooming one zooms all. Drawn by Plotly, which the page contains.

// Okabe and Ito's colours, which colour-blind readers can tell apart; lighter colours on a dark page.
const PALETTE = {
  light: ["#0072B2", "#D55E00", "#008060", "#A3407C", "#8A6100", "#3A7CA5", "#6B6B1F", "#555555"],
  dark: ["#56B4E9", "#FF9A5C", "#2FD1A0", "#F0A0D0", "#F0C040", "#9AD0F5", "#C9C95A", "#C8C8C8"],
};
const DASHES = ["solid", "dash", "dot", "dashdot", "longdash"];
const HEIGHT = 150, GAP = 46;

function isDark() {
  const chosen = document.documentElement.dataset.theme;
  return chosen ? chosen === "dark" : matchMedia("(prefers-color-scheme: dark)").matches;
}

function css(name) {
  return getComputedStyle(document.documentElement).getPropertyValue(name).trim();
}

function baseLayout() {
  const text = css("--text");
  return {
    paper_bgcolor: "rgba(0,0,0,0)", plot_bgcolor: "rgba(0,0,0,0)", font: { color: text, size: 13 },
    hoverlabel: { bgcolor: css("--card"), font: { color: text } }, uirevision: "kept", dragmode: "zoom",
  };
}

function axisStyle() {
  return { gridcolor: css("--grid"), zerolinecolor: css("--line"), linecolor: css("--line"), zeroline: true };
}

// The panels of several runs, one below the other, over a common time; onPick receives the time that is clicked.
class Charts {
  constructor(place, groups, onPick) {
    this.place = place;
    this.onPick = onPick;
    this.groups = groups;
    this.plot = document.createElement("div");
    this.now = document.createElement("div");
    this.now.className = "now";
    place.classList.add("chart");
    place.append(this.plot, this.now);
  }

  async draw() {
    const { traces, layout } = this.figure();
    const config = { responsive: true, displaylogo: false, modeBarButtonsToRemove: ["select2d", "lasso2d"] };
    await Plotly.react(this.plot, traces, layout, config);
    if (!this.listens) {
      this.listens = true;
      this.plot.on("plotly_click", (event) => this.onPick(event.points[0].x));
      this.plot.on("plotly_relayout", () => this.mark(this.t));
    }
    this.mark(this.t);
  }

  figure() {
    const names = [], titles = {};
    for (const group of this.groups)
      for (const panel of group.panels)
        if (!(panel.name in titles)) { names.push(panel.name); titles[panel.name] = panel; }
    const colours = PALETTE[isDark() ? "dark" : "light"], several = this.groups.length > 1;
    const whole = names.length * (HEIGHT + GAP), traces = [], layout = baseLayout();
    const narrow = this.place.clientWidth < 700;
    Object.assign(layout, {
      height: whole + 70, margin: { l: 70, r: narrow ? 12 : 210, t: 10, b: 50 }, annotations: [],
      hovermode: "x unified", hoversubplots: "axis", showlegend: true,
      xaxis: { ...axisStyle(), title: { text: "time (s)" }, anchor: `y${names.length}`, zeroline: false,
        showspikes: true, spikemode: "across", spikesnap: "cursor", spikethickness: 1, spikedash: "solid",
        spikecolor: css("--soft") },
    });
    names.forEach((name, k) => {
      const top = 1 - (k * (HEIGHT + GAP) + GAP * 0.6) / whole, bottom = top - HEIGHT / whole;
      const { title, unit } = titles[name], id = k ? k + 1 : "", lines = [];
      layout[`yaxis${id}`] = { ...axisStyle(), domain: [Math.max(bottom, 0), top], anchor: "x", title: { text: unit } };
      layout.annotations.push({ text: `<b>${title}</b>`, x: 0, xref: "paper", xanchor: "left", y: top, yref: "paper",
        yanchor: "bottom", showarrow: false });
      const legend = k ? `legend${k + 1}` : "legend";
      this.groups.forEach((group, g) => {
        const panel = group.panels.find((one) => one.name === name);
        (panel ? panel.lines : []).forEach((line, j) => {
          const many = panel.lines.length > 1, label = many ? line.name : title;
          lines.push({
            x: line.t, y: line.y, name: several ? `${group.label}${many ? `: ${line.name}` : ""}` : label,
            mode: "lines", xaxis: "x", yaxis: `y${id}`, legend, hovertemplate: "%{y:.4g}",
            line: { width: 1.4, color: line.dash ? css("--text") : colours[(several ? g : j) % colours.length],
              dash: line.dash ? "dash" : several ? DASHES[j % DASHES.length] : "solid" },
          });
        });
      });
      // the legend lists only one of the two dashed lines of linear theory
      const seen = new Set();
      for (const line of lines) { line.showlegend = lines.length > 1 && !seen.has(line.name); seen.add(line.name); line.legendgroup = `${k} ${line.name}`; }
      layout[legend] = { x: narrow ? 1 : 1.005, xanchor: narrow ? "right" : "left", y: top, yanchor: "top",
        bgcolor: "rgba(0,0,0,0)", font: { size: 11 }, tracegroupgap: 0, maxheight: HEIGHT };
      traces.push(...lines);
    });
    return { traces, layout };
  }

  // Moves the line that marks the time of the particles shown.
  mark(t) {
    this.t = t;
    const full = this.plot._fullLayout;
    if (t === undefined || !full || !full.xaxis || !full.xaxis.range) return;
    const [a, b] = full.xaxis.range, share = (t - a) / (b - a), size = full._size;
    const there = share >= 0 && share <= 1;
    Object.assign(this.now.style, {
      display: there ? "block" : "none", left: `${size.l + share * size.w - 1}px`, top: `${size.t}px`, height: `${size.h}px`,
    });
  }
}

async function drawSpectra(place, found) {
  const colours = PALETTE[isDark() ? "dark" : "light"];
  const traces = [];
  if (found.band)
    traces.push(
      { x: found.band.f, y: found.band.low, mode: "lines", line: { width: 0 }, showlegend: false, hoverinfo: "skip" },
      { x: found.band.f, y: found.band.high, mode: "lines", line: { width: 0 }, fill: "tonexty", name: "band of the incident waves",
        fillcolor: isDark() ? "rgba(86,180,233,.25)" : "rgba(0,114,178,.2)", hoverinfo: "skip" });
  found.lines.forEach((line, k) => traces.push({
    x: line.f, y: line.S, name: line.name, mode: "lines", hovertemplate: "%{y:.3g}",
    line: { width: 1.5, color: line.dash ? css("--text") : colours[k % colours.length], dash: line.dash ? "dash" : "solid" },
  }));
  const layout = { ...baseLayout(), height: 320, margin: { l: 70, r: 20, t: 10, b: 50 }, hovermode: "x unified",
    showlegend: traces.length > 1, legend: { x: 1, xanchor: "right", y: 1, bgcolor: "rgba(0,0,0,0)" },
    xaxis: { ...axisStyle(), title: { text: "frequency (Hz)" }, range: [0, found.top] },
    yaxis: { ...axisStyle(), title: { text: found.unit }, rangemode: "tozero" } };
  await Plotly.react(place, traces, layout, { responsive: true, displaylogo: false });
}
