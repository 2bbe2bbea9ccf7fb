"use strict";
// The record that jaxsph/report/pack.py writes: text and arrays, compressed by gzip.

async function inflate(bytes) {
  const stream = new Blob([bytes]).stream().pipeThrough(new DecompressionStream("gzip"));
  return new Response(stream).arrayBuffer();
}

function bytesOf(text) {
  if (Uint8Array.fromBase64) return Uint8Array.fromBase64(text);
  const raw = atob(text), bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

const ARRAYS = { f4: Float32Array, f8: Float64Array, u1: Uint8Array, u4: Uint32Array };

// Text of a record, with a typed array in place of every reference to an array.
async function readRecord(bytes) {
  const buffer = await inflate(bytes);
  const length = new DataView(buffer).getUint32(0, true);
  const text = new TextDecoder().decode(new Uint8Array(buffer, 4, length));
  const first = 4 + length;
  return JSON.parse(text, (_, value) => {
    if (value && typeof value === "object" && "at" in value && "n" in value && "type" in value)
      return new ARRAYS[value.type](buffer, first + value.at, value.n);
    return value;
  });
}

// Positions and fields of a run's frames, from their differences.
function readFrames(player) {
  const { count, t } = player, frames = t.length;
  const places = new Uint16Array(frames * 2 * count);
  for (let f = 0, from = 0; f < frames; f++)
    for (let axis = 0; axis < 2; axis++, from += 2 * count) {
      const to = (2 * f + axis) * count;
      for (let i = 0; i < count; i++) {
        const small = player.places[from + i] | (player.places[from + count + i] << 8);
        const step = (small >>> 1) ^ -(small & 1);
        places[to + i] = (f ? places[to - 2 * count + i] : 0) + step;
      }
    }
  const fields = {};
  for (const [name, field] of Object.entries(player.fields)) {
    const levels = new Uint8Array(field.levels);
    for (let k = count; k < levels.length; k++) levels[k] += levels[k - count];
    fields[name] = { ...field, levels };
  }
  return { places, fields };
}

// Position of a time among ascending times: the sample before it, and the share of the way to the next.
function placeAmong(times, t) {
  let low = 0, high = times.length - 1;
  if (high < 1 || t <= times[0]) return [0, 0];
  if (t >= times[high]) return [high - 1, 1];
  while (high - low > 1) {
    const middle = (low + high) >> 1;
    if (times[middle] <= t) low = middle; else high = middle;
  }
  return [low, (t - times[low]) / (times[high] - times[low])];
}
