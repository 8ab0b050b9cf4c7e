// Axes and written numbers, as axis.py and quantity.py have them.

const RAISED = "\u2070\u00b9\u00b2\u00b3\u2074\u2075\u2076\u2077\u2078\u2079";

const fixed = (value, decimals) => {
  const text = value.toFixed(Math.min(decimals, 20));
  return Number(text) === 0 ? text.replace("-", "") : text.replace("-", "\u2212");
};
const decimalsOf = (step) => Math.max(0, -Math.floor(Math.log10(step) + 1e-9));
const powerOfTen = (power) => "10" + [...String(power)].map((digit) => RAISED[digit] ?? "\u207b").join("");

const written = (value, axis) => { // to about a five-hundredth of what is in sight
  if (!Number.isFinite(value)) return "\u2013";
  const span = Math.abs(axis.log ? value : axis.high - axis.low) * axis.factor;
  return `${fixed(value * axis.factor, span > 0 ? decimalsOf(span / 500) : 0)} ${axis.unit}`.trim();
};

const axisOf = (spec, [low, high], pixels) => {
  const map = (value) => (spec.log ? (value > 0 ? Math.log(value) : NaN) : value);
  const from = map(low), span = map(high) - from;
  const value = (at) => from + (at / pixels) * span;
  return {
    ...spec, low, high,
    place: (of) => ((map(of) - from) / span) * pixels,
    value: spec.log ? (at) => Math.exp(value(at)) : value,
  };
};

const decades = (axis, count) => {
  const first = Math.ceil(Math.log10(axis.low) - 1e-9), last = Math.floor(Math.log10(axis.high) + 1e-9);
  const number = last - first + 1, dense = 3 * number <= count, found = [];
  const plain = first >= -3 && last <= 4;
  const stride = dense ? 1 : Math.max(1, Math.ceil(number / count));
  for (let power = dense ? first - 1 : first; power <= last; power += stride) {
    for (const digit of dense ? [1, 2, 5] : [1]) {
      const value = digit * 10 ** power;
      const far = digit === 1 ? powerOfTen(power) : `${digit}\u00b7${powerOfTen(power)}`;
      const text = plain || power === 0 ? fixed(value, Math.max(0, -power)) : far;
      if (value >= axis.low && value <= axis.high) found.push([value, text]);
    }
  }
  return found;
};

const ticks = (axis, count) => {
  if (axis.log && axis.high / axis.low >= 10) return decades(axis, count);
  const low = axis.low * axis.factor, high = axis.high * axis.factor, rough = (high - low) / Math.max(count, 3);
  const power = 10 ** Math.floor(Math.log10(rough)), found = [];
  const step = [10, 5, 2, 1].find((digit) => digit * power <= 1.5 * rough) * power;
  for (let at = Math.ceil(low / step - 0.01); at <= high / step + 0.01; at++) {
    found.push([(at * step) / axis.factor, fixed(at * step, decimalsOf(step))]);
  }
  return found;
};

// Samples: as packed by thin.py, and where a value lies among ascending ones.

const floats = (text, start = 0) => {
  const bytes = Uint8Array.from(atob(text), (letter) => letter.charCodeAt(0));
  const view = new DataView(bytes.buffer);
  return Float64Array.from({ length: bytes.length >> 2 }, (_, at) => start + view.getFloat32(4 * at, true));
};
const below = (values, target) => { // the first index whose value is not below the target
  let low = 0, high = values.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (values[middle] < target) low = middle + 1;
    else high = middle;
  }
  return low;
};
const nearest = (values, target) => {
  const at = Math.min(below(values, target), values.length - 1);
  return at > 0 && target - values[at - 1] < values[at] - target ? at - 1 : at;
};
