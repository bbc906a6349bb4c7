// The page: charts are drawn when they come into view; joints are switched for all of them.

const hiddenJoints = new Set();
const views = [...document.querySelectorAll("figure[data-chart]")].map((figure) => new ChartView(figure, DATA.charts[figure.dataset.chart]));
const inView = new IntersectionObserver((entries) => {
  for (const { isIntersecting, target } of entries) if (isIntersecting) {
    inView.unobserve(target);
    views.find((one) => one.figure === target).draw();
  }
}, { rootMargin: "300px" });
views.forEach((one) => inView.observe(one.figure));
document.documentElement.classList.add("live");

const several = new Set(DATA.charts.flatMap((chart) => chart.panels.flatMap((panel) => [panel.joint, ...panel.series.map((one) => one.joint)])).filter((one) => one !== null));
if (several.size > 1) {
  const bar = el("div", { id: "joints", role: "toolbar", "aria-label": "Joints shown" }, el("span", {}, "Joints"));
  for (const number of [...several].sort((a, b) => a - b)) {
    const button = el("button", { type: "button", "aria-pressed": "true", "data-toggles": number }, [number, DATA.joints[number - 1]].filter(Boolean).join(" "));
    button.addEventListener("click", () => {
      if (!hiddenJoints.delete(number)) hiddenJoints.add(number);
      button.setAttribute("aria-pressed", String(!hiddenJoints.has(number)));
      document.querySelectorAll(`details[data-joint="${number}"]`).forEach((one) => (one.hidden = hiddenJoints.has(number)));
      views.forEach((one) => one.choose());
    });
    bar.append(button);
  }
  bar.append(el("span", { class: "how" }, "Drag: zoom. Double click: all. Point: values."));
  document.querySelector("figure[data-chart]").before(bar);
}

let width = innerWidth;
addEventListener("resize", () => {
  if (innerWidth === width) return;
  width = innerWidth;
  clearTimeout(views.waiting);
  views.waiting = setTimeout(() => views.forEach((one) => one.drawn && one.draw()), 120);
});
DARKNESS.addEventListener("change", () => {
  views.forEach((one) => one.recolour());
  drawArm();
});
