"use strict";
// Decodes what EXT_meshopt_compression has in a glTF file: vertices (version 0 of their codec) and triangles (version 1 of theirs), without filters.
// A stream that does not hold what it should is an error; nothing is read beyond it.
const asraMeshopt = (() => {
  const BLOCK = 8192, MOST = 256, GROUP = 16, TAIL = 32;
  const torn = () => { throw new Error("an encoded stream is cut off or damaged"); };

  // Vertices: blocks of up to 256. Of a block there is byte 0 of all vertices, then byte 1, and so on, each as the difference from the vertex before, in groups of 16
  // with 0, 2, 4 or 8 bits; the greatest number of 2 or 4 bits stands for one that follows in full. The first vertex is at the end of the stream.
  //
  //   A0 | block | block | ... | tail: the first vertex
  //        for each byte: 2 bits a group | group | group | ...
  const vertices = (from, count, stride) => {
    if (stride < 4 || stride > 256 || stride % 4 || from.length < 1 + Math.max(stride, TAIL) || from[0] !== 0xa0) torn();
    const out = new Uint8Array(count * stride), end = from.length - Math.max(stride, TAIL);
    const last = from.slice(from.length - stride), most = Math.min(MOST, Math.floor(BLOCK / stride) & ~(GROUP - 1));
    const own = new Uint8Array(MOST);
    let at = 1;
    for (let first = 0; first < count; first += most) {
      const many = Math.min(most, count - first), groups = Math.ceil(many / GROUP);
      for (let k = 0; k < stride; k++) {
        const kinds = at;
        at += Math.ceil(groups / 4);
        if (at > end) torn();
        for (let group = 0; group < groups; group++) {
          const kind = from[kinds + (group >> 2)] >> 2 * (group & 3) & 3, start = group * GROUP;
          if (kind === 0) {
            own.fill(0, start, start + GROUP);
          } else if (kind === 3) {
            if (at + GROUP > end) torn();
            own.set(from.subarray(at, at + GROUP), start);
            at += GROUP;
          } else {
            const bits = 2 * kind, full = (1 << bits) - 1;
            let packed = at;
            at += 2 * bits;
            for (let i = 0; i < GROUP; packed++) {
              for (let shift = 8 - bits; shift >= 0; shift -= bits, i++) {
                const value = from[packed] >> shift & full;
                own[start + i] = value < full ? value : from[at++];
              }
            }
            if (at > end) torn();
          }
        }
        let before = last[k];
        for (let i = 0, to = first * stride + k; i < many; i++, to += stride) {
          const folded = own[i];
          before = before + (folded >> 1 ^ -(folded & 1)) & 255;
          out[to] = before;
        }
        last[k] = before;
      }
    }
    if (at !== end) torn();
    return out;
  };

  // Triangles: a code each. High bits name one of the last 15 edges, or say that the triangle has none of them; low bits name the third vertex: a new one, one of the
  // last, the last one that was told in full or one beside it, or one that is told in full.
  //
  //   E1 | a code for each triangle | what does not fit in a code | 16 codes of two vertices that are often used
  const triangles = (from, count, size) => {
    if (count % 3 || size !== 2 && size !== 4 || from.length < 1 + count / 3 + 16 || from[0] !== 0xe1) torn();
    const out = size === 2 ? new Uint16Array(count) : new Uint32Array(count), pairs = from.length - 16;
    const edges = new Uint32Array(32), recent = new Uint32Array(16);
    let edge = 0, vertex = 0, next = 0, last = 0, at = 1 + count / 3;
    const told = () => {
      let number = 0;
      for (let shift = 0; ; shift += 7) {
        if (at >= pairs || shift > 28) torn();
        const byte = from[at++];
        number |= (byte & 127) << shift;
        if (byte < 128) break;
      }
      return last = last + (number >>> 1 ^ -(number & 1)) >>> 0;
    };
    const keep = v => { recent[vertex] = v; vertex = vertex + 1 & 15; };
    const join = (a, b) => { edges[2 * edge] = a; edges[2 * edge + 1] = b; edge = edge + 1 & 15; };
    for (let i = 0, code = 1; i < count; i += 3, code++) {
      const high = from[code] >> 4, low = from[code] & 15;
      let a, b, c;
      if (high < 15) {
        const known = 2 * (edge - 1 - high & 15);
        [a, b] = [edges[known], edges[known + 1]];
        if (low < 13) {
          c = low === 0 ? next++ : recent[vertex - 1 - low & 15];
          if (low === 0) keep(c);
        } else {
          c = low === 15 ? told() : last = last + (low === 13 ? -1 : 1) >>> 0;
          keep(c);
        }
        join(c, b);
        join(a, c);
      } else {
        const whole = low >= 14;
        if (whole && at >= pairs) torn();
        const both = whole ? from[at++] : from[pairs + low], [second, third] = [both >> 4, both & 15];
        if (whole && both === 0) next = 0;
        const fresh = low === 15 ? null : next++;
        b = second === 0 ? next++ : recent[vertex - second & 15];
        c = third === 0 ? next++ : recent[vertex - third & 15];
        a = fresh === null ? told() : fresh;
        if (whole && second === 15) b = told();
        if (whole && third === 15) c = told();
        keep(a);
        if (second === 0 || whole && second === 15) keep(b);
        if (third === 0 || whole && third === 15) keep(c);
        join(b, a);
        join(c, b);
        join(a, c);
      }
      out[i] = a;
      out[i + 1] = b;
      out[i + 2] = c;
    }
    if (at !== pairs) torn();
    return new Uint8Array(out.buffer);
  };

  // The bytes of a view of buffers, as its extension tells of them.
  return (from, {count, byteStride, mode, filter}) => {
    // No stream of so few bytes has more: 16 bytes take two bits at the least.
    if (!(count >= 0) || count * byteStride > 64 * from.length) torn();
    if (filter && filter !== "NONE") throw new Error(`the filter ${filter} is not known here`);
    if (mode === "ATTRIBUTES") return vertices(from, count, byteStride);
    if (mode === "TRIANGLES") return triangles(from, count, byteStride);
    throw new Error(`the mode ${mode} is not known here`);
  };
})();
