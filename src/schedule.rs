//! The shape of every parallel pass: jobs go out in order, results come back in order, few are in flight.
//!
//! ```text
//!  source --job 0,1,2…--> [worker] [worker] … --result--> (reordered) --0,1,2…--> sink
//!  at most `in_flight` jobs exist between source and sink: that product is the pass's memory
//! ```
//!
//! Source and sink run on the calling thread, so both may hold `&mut` state; the work runs on a pool. As the sink sees the
//! results in job order, nothing downstream can depend on the number of threads.

use std::collections::BTreeMap;
use std::sync::atomic::{AtomicBool, Ordering};
use std::sync::{Arc, Mutex};

use crate::error::{Error, Result};

/// Worker threads and the wish to stop, shared by all passes of a run.
#[derive(Debug, Clone)]
pub struct Workers {
    pool: Arc<rayon::ThreadPool>,
    cancelled: Arc<AtomicBool>,
}

impl Workers {
    /// A pool of `threads` workers (at least one).
    ///
    /// # Errors
    /// [`Error::Io`] if the system refuses the threads.
    pub fn new(threads: usize) -> Result<Workers> {
        let pool = rayon::ThreadPoolBuilder::new()
            .num_threads(threads.max(1))
            .thread_name(|i| format!("asra-worker-{i}"))
            .build()
            .map_err(|e| Error::io("threads", "start")(std::io::Error::other(e)))?;
        Ok(Workers { pool: Arc::new(pool), cancelled: Arc::default() })
    }

    /// The number of worker threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// The pool itself, for passes that need no order.
    pub fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// The flag that stops every pass at its next job when set, with [`Error::Interrupted`].
    pub fn cancel_flag(&self) -> Arc<AtomicBool> {
        Arc::clone(&self.cancelled)
    }

    /// [`Error::Interrupted`] once the flag is set.
    ///
    /// # Errors
    /// See above.
    pub fn check_cancelled(&self) -> Result<()> {
        if self.cancelled.load(Ordering::Relaxed) { Err(Error::Interrupted) } else { Ok(()) }
    }

    /// Runs `work` on every job of `source` and hands the results to `sink` in job order.
    ///
    /// `source` gives `None` at the end. At most `in_flight` (at least one) jobs and results exist at a time. One at a time is worked on by the
    /// calling thread: memory that one thread takes and another gives back would wait for the first.
    /// The first error of source, work or sink, in job order, ends the pass; jobs under way are finished and dropped.
    ///
    /// # Errors
    /// The first error met, or [`Error::Interrupted`].
    pub fn in_order<J: Send, R: Send>(
        &self,
        in_flight: usize,
        mut source: impl FnMut() -> Result<Option<J>>,
        work: impl Fn(J) -> Result<R> + Sync,
        mut sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        if in_flight <= 1 {
            while let Some(job) = source()? {
                self.check_cancelled()?;
                sink(work(job)?)?;
            }
            return Ok(());
        }
        let (done, results) = crossbeam_channel::bounded::<(usize, Result<R>)>(in_flight);
        let work = &work;
        self.pool.in_place_scope(|scope| {
            let mut waiting = BTreeMap::new();
            let (mut started, mut sunk) = (0usize, 0usize);
            let mut exhausted = false;
            loop {
                self.check_cancelled()?;
                while !exhausted && started - sunk < in_flight {
                    match source()? {
                        None => exhausted = true,
                        Some(job) => {
                            let (done, number) = (done.clone(), started);
                            // The channel holds `in_flight` results, so a worker never blocks on sending.
                            scope.spawn(move |_| drop(done.send((number, work(job)))));
                            started += 1;
                        }
                    }
                }
                if sunk == started {
                    return Ok(());
                }
                let (number, result) = results.recv().expect("a worker panicked");
                waiting.insert(number, result);
                while let Some(result) = waiting.remove(&sunk) {
                    sink(result?)?;
                    sunk += 1;
                }
            }
        })
    }

    /// [`Workers::in_order`] over the numbers `0..jobs`.
    ///
    /// # Errors
    /// As [`Workers::in_order`].
    pub fn in_order_range<R: Send>(
        &self,
        in_flight: usize,
        jobs: usize,
        work: impl Fn(usize) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let mut numbers = 0..jobs;
        self.in_order(in_flight, || Ok(numbers.next()), work, sink)
    }
}

const NO_PANIC: &str = "nothing panics while the list is held";

/// Working memory that jobs hand on to later ones: as many as ever were at work at a time.
#[derive(Debug, Default)]
pub struct Spares<T>(Mutex<Vec<T>>);

impl<T> Spares<T> {
    /// Working memory that is not in use, if there is any.
    pub fn take(&self) -> Option<T> {
        self.0.lock().expect(NO_PANIC).pop()
    }

    /// Gives back what is no longer in use.
    pub fn give(&self, spare: T) {
        self.0.lock().expect(NO_PANIC).push(spare);
    }
}

impl<T: Default> Spares<T> {
    /// Lends a job working memory that an earlier one may have used.
    pub fn lend<R>(&self, job: impl FnOnce(&mut T) -> R) -> R {
        let mut spare = self.take().unwrap_or_default();
        let result = job(&mut spare);
        self.give(spare);
        result
    }
}

/// Fills a vector that was used before with `count` values, with no more room than that if it has to grow.
pub fn refill<T: Clone>(used: &mut Vec<T>, count: usize, value: T) {
    used.clear();
    used.reserve_exact(count);
    used.resize(count, value);
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn results_arrive_in_order_whatever_the_threads() {
        for threads in [1, 2, 7] {
            for in_flight in [1, 2, 16] {
                let workers = Workers::new(threads).unwrap();
                let mut seen = Vec::new();
                let slow_first = |i: usize| {
                    if i.is_multiple_of(5) {
                        std::thread::sleep(std::time::Duration::from_millis(2));
                    }
                    Ok(i * i)
                };
                workers
                    .in_order_range(in_flight, 50, slow_first, |r| {
                        seen.push(r);
                        Ok(())
                    })
                    .unwrap();
                assert_eq!(seen, (0..50).map(|i| i * i).collect::<Vec<_>>());
            }
        }
    }

    #[test]
    fn the_first_error_in_job_order_ends_the_pass() {
        let workers = Workers::new(3).unwrap();
        let mut seen = 0;
        let fail = |i: usize| if i >= 7 { Err(Error::Usage(format!("job {i}"))) } else { Ok(i) };
        let error = workers
            .in_order_range(4, 100, fail, |_| {
                seen += 1;
                Ok(())
            })
            .unwrap_err();
        assert_eq!(error.to_string(), "job 7");
        assert_eq!(seen, 7);
    }

    #[test]
    fn a_set_flag_interrupts() {
        let workers = Workers::new(2).unwrap();
        let flag = workers.cancel_flag();
        let error = workers
            .in_order_range(
                2,
                1000,
                |i| {
                    if i == 10 {
                        flag.store(true, Ordering::Relaxed);
                    }
                    Ok(())
                },
                |()| Ok(()),
            )
            .unwrap_err();
        assert!(matches!(error, Error::Interrupted));
    }
}
