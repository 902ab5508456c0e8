"use strict";
// Turns the drawings in space with the pointer or the arrow keys. Without it the report is complete.
(() => {
  const frames = [...document.querySelectorAll(".turns")].map((group) => ({ group, points: JSON.parse(group.dataset.points) }));
  let azimuth = -58;
  let elevation = 22;

  function project([x, y, z], box) {
    const [a, e] = [azimuth, elevation].map((angle) => (angle * Math.PI) / 180);
    const right = -Math.sin(a) * x + Math.cos(a) * y;
    const up = -Math.sin(e) * (Math.cos(a) * x + Math.sin(a) * y) + Math.cos(e) * z;
    return [box.width / 2 + right, box.height / 2 - up].map((value) => value.toFixed(1));
  }

  function draw() {
    for (const { group, points } of frames) {
      const at = points.map((point) => project(point, group.ownerSVGElement.viewBox.baseVal));
      for (const path of group.querySelectorAll("path")) {
        const [a, b] = path.dataset.ends.split(" ");
        path.setAttribute("d", `M${at[a].join(" ")}L${at[b].join(" ")}`);
      }
      for (const text of group.querySelectorAll("text")) {
        text.setAttribute("x", at[text.dataset.at][0]);
        text.setAttribute("y", at[text.dataset.at][1]);
      }
    }
  }

  function turn(right, up) {
    azimuth -= right;
    elevation = Math.min(90, Math.max(-90, elevation + up));
    draw();
  }

  const keys = { ArrowLeft: [-5, 0], ArrowRight: [5, 0], ArrowUp: [0, 5], ArrowDown: [0, -5] };
  for (const { group } of frames) {
    const sheet = group.ownerSVGElement;
    sheet.classList.add("turning");
    sheet.setAttribute("tabindex", "0");
    sheet.addEventListener("pointerdown", (event) => sheet.setPointerCapture(event.pointerId));
    sheet.addEventListener("pointermove", (event) => {
      if (sheet.hasPointerCapture(event.pointerId)) turn(event.movementX / 2, event.movementY / 2);
    });
    sheet.addEventListener("keydown", (event) => {
      if (!(event.key in keys)) return;
      event.preventDefault();
      turn(...keys[event.key]);
    });
  }
})();
