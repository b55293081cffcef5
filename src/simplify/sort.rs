//! Numbers in order, by their digits: for many at a time, as a part has them, a fraction of what comparing them takes.

/// Bits of a digit.
const DIGIT: u32 = 11;

/// Sorts numbers whose lower halves come in order already, as those of a list's places do, by their upper halves. Takes as much memory again.
pub(super) fn sort(numbers: &mut Vec<u64>) {
    let high = |number: &u64| (number >> 32) as u32;
    let Some(least) = numbers.iter().map(high).min() else { return };
    let most = numbers.iter().map(high).max().unwrap_or(least) - least;
    let mut other = Vec::new();
    for shift in (0..u32::BITS - most.leading_zeros()).step_by(DIGIT as usize) {
        let digit = |number: &u64| ((high(number) - least) >> shift) as usize & ((1 << DIGIT) - 1);
        // Where those with each digit begin.
        let mut places = [0u32; 1 << DIGIT];
        numbers.iter().for_each(|number| places[digit(number)] += 1);
        let mut before = 0;
        for place in &mut places {
            (*place, before) = (before, before + *place);
        }
        other.resize(numbers.len(), 0);
        for number in &*numbers {
            let place = &mut places[digit(number)];
            other[*place as usize] = *number;
            *place += 1;
        }
        std::mem::swap(numbers, &mut other);
    }
}
