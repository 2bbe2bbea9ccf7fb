"use strict";
// Results of a sweep, a power matrix or a search over the varied parameters; a click opens a member.

class Map2 {
  constructor(place, sweep, onOpen) {
    this.place = place;
    this.sweep = sweep;
    this.onOpen = onOpen;
    this.of = sweep.first;
  }

  async draw() {
    const { traces, layout } = this.sweep.axes.length === 1 || !this.sweep.grid ? this.lines() : this.matrix();
    await Plotly.react(this.place, traces, layout, { responsive: true, displaylogo: false });
    if (!this.listens) {
      this.listens = true;
      this.place.on("plotly_click", (event) => {
        const members = event.points[0].customdata;
        if (members && members.length) this.onOpen(members);
      });
    }
  }

  label() {
    const found = this.sweep.choices.find((one) => one.name === this.of);
    return found ? found.text.trim() + (found.unit ? ` (${found.unit})` : "") : this.of;
  }

  layout(x, y) {
    return { ...baseLayout(), height: 420, margin: { l: 80, r: 20, t: 40, b: 60 }, showlegend: false, clickmode: "event",
      xaxis: { ...axisStyle(), title: { text: x }, zeroline: false }, yaxis: { ...axisStyle(), title: { text: y }, zeroline: false } };
  }

  // One parameter, or a search: points over the first parameter; the points of a search have numbers and slopes.
  lines() {
    const { axes, members, kind } = this.sweep, colours = PALETTE[isDark() ? "dark" : "light"];
    const there = members.filter((one) => this.of in one.results), search = kind === "search";
    if (!search) there.sort((a, b) => a.at[0] - b.at[0]);
    const x = there.map((one) => one.at[0]), y = there.map((one) => one.results[this.of]);
    const traces = [{
      x, y, customdata: there.map((one) => [one.index]), mode: search ? "markers+lines+text" : "markers+lines", name: this.label(),
      text: search ? there.map((_, k) => `${k + 1}`) : undefined, textposition: "top right",
      error_y: this.of === "xi" && !search ? { type: "data", array: there.map((one) => one.results.xi_error ?? 0), thickness: 1 } : undefined,
      marker: { size: 9, color: colours[0] }, line: { width: 1.2, dash: search ? "dot" : "solid", color: colours[0] },
      hovertemplate: there.map((one) => `${one.place}<br>${this.label()} = %{y:.4g}<extra></extra>`),
    }];
    const linear = there.filter((one) => this.of in one.linear);
    if (linear.length)
      traces.push({ x: linear.map((one) => one.at[0]), y: linear.map((one) => one.linear[this.of]), mode: "lines",
        name: "linear theory", line: { dash: "dash", width: 1.4, color: css("--text") }, hovertemplate: "linear theory %{y:.4g}<extra></extra>" });
    const limits = there.filter((one) => this.of in one.limits);
    if (limits.length)
      traces.push({ x: limits.map((one) => one.at[0]), y: limits.map((one) => one.limits[this.of][0]), mode: "markers", name: "limit for spacing zero",
        error_y: { type: "data", array: limits.map((one) => one.limits[this.of][1]), thickness: 1 }, customdata: limits.map((one) => [one.index]),
        marker: { size: 9, symbol: "diamond-open", color: colours[1] }, hovertemplate: "limit %{y:.4g}<extra></extra>" });
    if (search) {
      const slope = `slope ${axes[0].name}`, reach = 0.04 * (Math.max(...x) - Math.min(...x) || Math.abs(x[0]) || 1);
      for (const one of there)
        if (slope in one.results)
          traces.push({ x: [one.at[0] - reach, one.at[0] + reach], y: [-1, 1].map((s) => one.results[this.of] + s * reach * one.results[slope]),
            mode: "lines", line: { width: 3, color: colours[1] }, hoverinfo: "skip" });
    }
    const layout = this.layout(axes[0].name, this.label());
    layout.showlegend = linear.length + limits.length > 0;
    layout.legend = { orientation: "h", x: 0, y: 1.01, yanchor: "bottom", bgcolor: "rgba(0,0,0,0)" }; // beside the toolbar
    return { traces, layout };
  }

  // Standard error of a member's own mean over its sea.
  within(one) {
    const { xi_error, P_inc } = one.results;
    if (xi_error === undefined) return 0;
    return { xi: xi_error, P_owc: xi_error * P_inc, P_pto: xi_error * P_inc }[this.of] || 0;
  }

  // Two or more parameters: a cell for every pair of values of the first two, with the mean of its members.
  matrix() {
    const { axes, members } = this.sweep, [first, second] = axes;
    const cells = first.values.map((a) => second.values.map((b) => members.filter((one) => one.at[0] === a && one.at[1] === b)));
    const mean = (all, of) => {
      const values = all.map(of).filter((v) => v !== undefined);
      return values.length ? values.reduce((a, b) => a + b, 0) / values.length : null;
    };
    const z = cells.map((row) => row.map((all) => mean(all, (one) => one.results[this.of])));
    const linear = cells.map((row) => row.map((all) => mean(all, (one) => one.linear[this.of])));
    const short = (v) => (v === null ? "" : Number(v.toPrecision(3)).toString());
    const text = z.map((row, i) => row.map((v, j) => {
      if (v === null) return cells[i][j].length ? "failed" : "not yet";
      const values = cells[i][j].map((one) => one.results[this.of]).filter((one) => one !== undefined), count = values.length;
      // as in js.power_matrix: the larger of the error from the scatter of the members and the error of their own means
      const between = count > 1 ? Math.sqrt(values.reduce((s, one) => s + (one - v) ** 2, 0) / (count - 1) / count) : 0;
      const within = Math.sqrt(cells[i][j].reduce((s, one) => s + this.within(one) ** 2, 0)) / count;
      const error = Math.max(between, within);
      const [limit] = cells[i][j].map((one) => one.limits[this.of]).filter((one) => one !== undefined);
      const spaced = limit ? `<br>limit ${short(limit[0])} ± ${short(Number(limit[1].toPrecision(2)))}` : "";
      return short(v) + spaced + (error > 0 ? `<br>± ${short(Number(error.toPrecision(1)))}` : "") + (linear[i][j] === null ? "" : `<br><i>linear ${short(linear[i][j])}</i>`);
    }));
    const traces = [{
      type: "heatmap", x: second.values.map(String), y: first.values.map(String), z, text, texttemplate: "%{text}", colorscale: "Viridis",
      customdata: cells.map((row) => row.map((all) => all.map((one) => one.index))), xgap: 2, ygap: 2,
      hovertemplate: `${first.name} = %{y}<br>${second.name} = %{x}<br>${this.label()} = %{z:.4g}<extra></extra>`,
      colorbar: { title: { text: this.label(), side: "right" } },
    }];
    const layout = this.layout(second.name, first.name);
    layout.xaxis.type = layout.yaxis.type = "category";
    return { traces, layout };
  }
}
