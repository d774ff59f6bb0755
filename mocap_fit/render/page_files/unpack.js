"use strict";
// Arrays of the record: little-endian numbers, compressed with zlib, as base64.

const KINDS = {
  int8: Int8Array, uint8: Uint8Array, int16: Int16Array, uint16: Uint16Array,
  int32: Int32Array, uint32: Uint32Array, float32: Float32Array,
};

function toBytes(text) {
  const raw = atob(text);
  const bytes = new Uint8Array(raw.length);
  for (let i = 0; i < raw.length; i++) bytes[i] = raw.charCodeAt(i);
  return bytes;
}

async function unpackArray(packed) {
  const stream = new Blob([toBytes(packed.packed)]).stream();
  const buffer = await new Response(
    stream.pipeThrough(new DecompressionStream("deflate"))).arrayBuffer();
  const values = new KINDS[packed.kind](buffer);
  values.shape = packed.shape;
  values.scale = packed.scale;
  return values;
}

// Replace every packed array in a record by its numbers, wherever it is.
async function unpack(record) {
  if (record === null || typeof record !== "object") return record;
  if (record.packed !== undefined) return unpackArray(record);
  await Promise.all(Object.keys(record).map(async (key) => {
    record[key] = await unpack(record[key]);
  }));
  return record;
}

// The record is text, and may hold NaN and Infinity as Python writes them only inside arrays.
function readRecord() {
  return unpack(JSON.parse(document.getElementById("record").textContent));
}

// The number of the first of increasing numbers that is larger than a value.
function searchRight(numbers, value) {
  let low = 0, high = numbers.length;
  while (low < high) {
    const middle = (low + high) >> 1;
    if (numbers[middle] <= value) low = middle + 1; else high = middle;
  }
  return low;
}
