// Hands the pointer's acts to Python one at a time: the next goes out once the last is drawn, and of
// moves that wait the latest alone. So a page never lags behind a hand, however long a map takes.
// Arguments: `pointer`, a source that Python listens to; `drawn`, one that it answers by; `hover`,
// the tool that shows gains, which would cover what is dragged.
const waiting = (pointer._waiting ??= []);

if (cb_obj === drawn) {
  pointer._is_busy = false;
} else {
  const act = cb_obj.event_name;
  hover.active = act !== "panstart" && act !== "pan";
  if (act === "pan" && waiting.at(-1)?.act === "pan") {
    waiting.pop();
  }
  waiting.push({ act, x: cb_obj.x, y: cb_obj.y });
}

if (!pointer._is_busy && waiting.length > 0) {
  pointer._is_busy = true;
  pointer._count = (pointer._count ?? 0) + 1;
  const { act, x, y } = waiting.shift();
  pointer.data = { act: [act], x: [x], y: [y], count: [pointer._count] };
}
