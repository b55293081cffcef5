use proptest::prelude::*;

use super::*;

/// A naive encoder: at each byte the longest copy of what came before, else the byte as it is.
pub fn packed(bytes: &[u8]) -> Vec<u8> {
    let mut out = Vec::new();
    let mut at = 0;
    while at < bytes.len() {
        let same =
            |from: usize| (0..264.min(bytes.len() - at)).take_while(|i| bytes[from + i] == bytes[at + i]).count();
        let best = (at.saturating_sub(REACH)..at).map(|from| (same(from), from)).max();
        match best {
            Some((length @ 3.., from)) => {
                let distance = at - from - 1;
                let [high, low] = [(distance >> 8) as u8, distance as u8];
                if length < 9 {
                    out.extend([(length as u8 - 2) << 5 | high, low]);
                } else {
                    out.extend([7 << 5 | high, (length - 9) as u8, low]);
                }
                at += length;
            }
            _ => {
                out.extend([0, bytes[at]]);
                at += 1;
            }
        }
    }
    out
}

fn unpacked(mut bytes: &[u8]) -> Option<Vec<u8>> {
    let mut lzf = Lzf::default();
    let mut out = Vec::new();
    while !bytes.is_empty() {
        let used = lzf.token(bytes).ok()??;
        bytes = &bytes[used..];
        lzf.hand_on(false, |piece| {
            out.extend_from_slice(piece);
            Ok::<(), ()>(())
        })
        .unwrap();
        assert!(lzf.held.len() < REACH + PIECE + 264, "memory is bounded");
    }
    lzf.hand_on(true, |piece| {
        out.extend_from_slice(piece);
        Ok::<(), ()>(())
    })
    .unwrap();
    Some(out)
}

#[test]
fn long_streams_are_handed_on_piece_by_piece() {
    // 264 zeros at a time, from the byte before.
    let bytes = [vec![0, 0], [0xe0, 255, 0].repeat(10_000)].concat();
    assert_eq!(unpacked(&bytes), Some(vec![0; 1 + 264 * 10_000]));
}

#[test]
fn what_cannot_be_is_refused() {
    for bytes in
        [[0x20, 0].as_slice(), &[0, 1, 0x20, 1], &[0, 1, 0xe0, 0, 1], &[0], &[31, 1], &[0, 1, 0x20], &[0, 1, 0xe0, 0]]
    {
        assert_eq!(unpacked(bytes), None, "{bytes:?}");
    }
}

proptest! {
    #[test]
    fn what_is_packed_is_unpacked(bytes in prop::collection::vec(0u8..3, 0..3000), far in 0usize..9000) {
        let bytes = [bytes.as_slice(), &vec![7; far], &bytes].concat();
        prop_assert_eq!(unpacked(&packed(&bytes)), Some(bytes));
    }
}
