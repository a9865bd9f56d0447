// How a map is moved and zoomed, by pointer, wheel and keys.
function mapMoves(section, canvas, state, places, painter, acts) {
  function fit() {
    painter.resize();
    state.moved = false;
    const map = section.maps[state.map];
    state.scale = Math.min(canvas.clientWidth / map.width, canvas.clientHeight / map.height) || 1;
    state.x = (canvas.clientWidth - map.width * state.scale) / 2;
    state.y = (canvas.clientHeight - map.height * state.scale) / 2;
  }

  function zoom(factor, x = canvas.clientWidth / 2, y = canvas.clientHeight / 2) {
    const next = Math.min(40, Math.max(0.05, state.scale * factor));
    state.x = x - ((x - state.x) * next) / state.scale;
    state.y = y - ((y - state.y) * next) / state.scale;
    state.scale = next;
    state.moved = true;
    painter.draw();
  }

  function centreAt(x, y) {
    if (Number.isNaN(x)) return;
    state.moved = true;
    state.x = canvas.clientWidth / 2 - x * state.scale;
    state.y = canvas.clientHeight / 2 - y * state.scale;
  }

  // Shows the chosen query with its tiles, as large as it can.
  function frame() {
    if (state.chosen < 0) return;
    const points = [places.centreOf(state.chosen), ...places.outlineOf(state.chosen),
      ...places.tilesAt(state.chosen).flatMap((one) => places.outlineOfTile(one.tile))].filter(([x]) => !Number.isNaN(x));
    if (!points.length) return;
    const [[left, right], [above, below]] = [0, 1].map((axis) => {
      const values = points.map((one) => one[axis]);
      return [Math.min(...values), Math.max(...values)];
    });
    const fits = Math.min(canvas.clientWidth / (right - left), canvas.clientHeight / (below - above)) * 0.85;
    state.scale = Math.min(6, Math.max(0.05, fits));
    centreAt((left + right) / 2, (above + below) / 2);
  }

  function inSight(place) {
    const [x, y] = places.centreOf(place);
    const [left, top] = [x * state.scale + state.x, y * state.scale + state.y];
    return left > 0 && top > 0 && left < canvas.clientWidth && top < canvas.clientHeight;
  }

  function keys(event) {
    const moves = { ArrowLeft: [60, 0], ArrowRight: [-60, 0], ArrowUp: [0, 60], ArrowDown: [0, -60] };
    const named = { "+": () => zoom(1.5), "=": () => zoom(1.5), "-": () => zoom(1 / 1.5), n: () => acts.step(1), p: () => acts.step(-1),
      Escape: acts.letGo, 0: () => { fit(); painter.draw(); } };
    if (event.ctrlKey || event.metaKey || event.altKey) return;
    if (event.key in moves) { state.moved = true; state.x += moves[event.key][0]; state.y += moves[event.key][1]; painter.draw(); }
    else if (event.key in named) named[event.key]();
    else return;
    event.preventDefault();
  }

  // The wheel zooms only where the map was chosen, so that it never holds up the page.
  function wheel(event) {
    if (document.activeElement !== canvas && !event.ctrlKey) return;
    event.preventDefault();
    zoom(event.deltaY < 0 ? 1.2 : 1 / 1.2, event.offsetX, event.offsetY);
  }

  function press(event) {
    const start = [event.clientX, event.clientY, state.x, state.y];
    const mouse = event.pointerType === "mouse";
    const move = (moved) => {
      if (!mouse && !state.moved) return;
      state.moved = true;
      state.x = start[2] + moved.clientX - start[0];
      state.y = start[3] + moved.clientY - start[1];
      painter.draw();
    };
    const release = (end) => {
      window.removeEventListener("pointermove", move);
      window.removeEventListener("pointerup", release);
      window.removeEventListener("pointercancel", release);
      if (end.type === "pointerup" && Math.hypot(end.clientX - start[0], end.clientY - start[1]) < 4) acts.choose(nearest(event.offsetX, event.offsetY));
    };
    window.addEventListener("pointermove", move);
    window.addEventListener("pointerup", release);
    window.addEventListener("pointercancel", release);
  }

  // The query that is drawn nearest to a place of the canvas, -1 where none is drawn.
  function nearest(x, y) {
    const at = [(x - state.x) / state.scale, (y - state.y) / state.scale];
    let [least, found] = [Infinity, -1];
    for (let place = 0; place < state.rows.length; place += 1) {
      const [px, py] = places.centreOf(place);
      const away = places.isShown(place) ? Math.hypot(px - at[0], py - at[1]) : NaN;
      if (away < least) [least, found] = [away, place];
    }
    return found;
  }

  canvas.addEventListener("keydown", keys);
  canvas.addEventListener("pointerdown", press);
  canvas.addEventListener("wheel", wheel, { passive: false });
  new ResizeObserver(() => {
    if (!state.picture || !canvas.clientWidth) return;
    if (state.moved) painter.resize();
    else fit();
    painter.draw();
  }).observe(canvas);
  return { fit, zoom, centreAt, frame, inSight };
}
