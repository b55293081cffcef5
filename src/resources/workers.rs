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
use std::time::Duration;

use crossbeam_channel::{Receiver, RecvTimeoutError};

use crate::error::defect;
use crate::error::{Error, Result};
use crate::resources::allocator;

/// How long a result is waited for before the wish to stop is looked at again.
const LOOK: Duration = Duration::from_millis(50);

/// A job's work, which leaves its result where its pass finds it.
type Task<'a> = Box<dyn FnOnce() + Send + 'a>;

/// Worker threads and the wish to stop, shared by all passes of a run.
#[derive(Debug, Clone)]
pub struct Workers {
    pool: Arc<rayon::ThreadPool>,
    /// The system refused every thread: the calling one does all the work.
    alone: bool,
    cancelled: Arc<AtomicBool>,
    /// Whether memory is so short that every pass ends with all threads giving back what they have freed in it.
    is_short: Arc<AtomicBool>,
    #[cfg(test)]
    fault: Arc<fault::Fault>,
}

impl Workers {
    /// A pool of `threads` workers (at least one). If the system refuses so many, it has fewer: that costs time, not the run.
    ///
    /// # Errors
    /// [`Error::Io`] if not even the calling thread can be a worker.
    pub fn new(threads: usize) -> Result<Workers> {
        let mut threads = threads.max(1);
        let named =
            |threads| rayon::ThreadPoolBuilder::new().num_threads(threads).thread_name(|i| format!("asra-worker-{i}"));
        let (pool, alone) = loop {
            match named(threads).build() {
                Ok(pool) => break (pool, false),
                Err(_) if threads > 1 => threads /= 2,
                Err(_) => {
                    let pool = named(1).use_current_thread().build();
                    break (pool.map_err(|e| Error::io("threads", "start")(std::io::Error::other(e)))?, true);
                }
            }
        };
        Ok(Workers {
            pool: Arc::new(pool),
            alone,
            cancelled: Arc::default(),
            is_short: Arc::default(),
            #[cfg(test)]
            fault: Arc::default(),
        })
    }

    /// The number of worker threads.
    pub fn threads(&self) -> usize {
        self.pool.current_num_threads()
    }

    /// The pool itself, for passes that need no order.
    pub fn pool(&self) -> &rayon::ThreadPool {
        &self.pool
    }

    /// Has every thread give back the memory that it has freed: a worker that waits for its next job does not come to it by itself.
    pub fn give_back(&self) {
        if !self.alone {
            self.pool.broadcast(|_| allocator::give_back());
        }
        allocator::give_back();
    }

    /// [`Workers::give_back`] without waiting: each thread does it when it has nothing else to do. What one thread took and another freed stays with the first until then.
    pub fn give_back_soon(&self) {
        if !self.alone {
            self.pool.spawn_broadcast(|_| allocator::give_back());
        }
    }

    /// Says whether memory is short: then each pass ends with all threads giving back what they have freed in it. Else it stays with them while others take memory
    /// for the next pass, and what is resident is the sum of what each thread ever took.
    pub fn give_back_after_passes(&self, is_short: bool) {
        self.is_short.store(is_short, Ordering::Relaxed);
    }

    /// Where memory is short, has every thread give back what it has freed: between steps that take as much again.
    pub fn between_steps(&self) {
        if self.is_short.load(Ordering::Relaxed) {
            self.give_back();
        }
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
    /// The first error of source, work or sink, in job order, ends the pass; jobs under way are finished and dropped, others are not begun. A panic
    /// is an error like any other: no one waits for a result that never comes.
    ///
    /// # Errors
    /// The first error met, [`Error::Internal`] for a panic, or [`Error::Interrupted`].
    pub fn in_order<J: Send, R: Send>(
        &self,
        in_flight: usize,
        source: impl FnMut() -> Result<Option<J>>,
        work: impl Fn(J) -> Result<R> + Sync,
        sink: impl FnMut(R) -> Result<()>,
    ) -> Result<()> {
        let (mut source, mut sink) = (source, sink);
        let results: Vec<Mutex<Option<Result<R>>>> = (0..in_flight.max(1)).map(|_| Mutex::default()).collect();
        let (results, work) = (&results, &work);
        let result = |number: usize| results[number % results.len()].lock().expect(NO_PANIC);
        let mut begin = |number: usize| {
            let Some(job) = source()? else { return Ok(None) };
            let task: Task = Box::new(move || {
                let done = work(job);
                *result(number) = Some(done);
            });
            Ok(Some(task))
        };
        let mut end = |number: usize| {
            let done = result(number).take();
            sink(done.unwrap_or_else(|| Err(Error::Internal("a job is done, but has no result".into())))?)
        };
        self.drive(in_flight, &mut begin, &mut end)
    }

    /// [`Workers::in_order`] without its types, so that the compiler makes this part once and not for each of hundreds of passes. `begin` makes the task of the job with a number, or
    /// gives `None` at the end; `end` hands on what the task has left.
    fn drive<'a>(
        &self,
        in_flight: usize,
        begin: &mut dyn FnMut(usize) -> Result<Option<Task<'a>>>,
        end: &mut dyn FnMut(usize) -> Result<()>,
    ) -> Result<()> {
        #[cfg(test)]
        let fault = self.fault.of_next_pass();
        let mut begin = |number: usize| {
            #[cfg(test)]
            fault.reach(fault::Part::Source);
            begin(number)
        };
        let run = |task: Task<'a>| {
            #[cfg(test)]
            fault.reach(fault::Part::Work);
            task();
        };
        let mut end = |number: usize| {
            #[cfg(test)]
            fault.reach(fault::Part::Sink);
            end(number)
        };
        if in_flight <= 1 || self.alone {
            return defect::caught(|| {
                while let Some(task) = begin(0)? {
                    self.check_cancelled()?;
                    run(task);
                    end(0)?;
                }
                Ok(())
            });
        }
        let (done, finished) = crossbeam_channel::bounded::<(usize, Result<()>)>(in_flight);
        let (run, over) = (&run, &AtomicBool::new(false));
        let outcome = self.pool.in_place_scope(|scope| {
            let mut waiting = BTreeMap::new();
            let (mut started, mut sunk) = (0usize, 0usize);
            let mut exhausted = false;
            let mut pass = || loop {
                self.check_cancelled()?;
                while !exhausted && started - sunk < in_flight {
                    match begin(started)? {
                        None => exhausted = true,
                        Some(task) => {
                            let (done, number) = (done.clone(), started);
                            // The channel holds `in_flight` messages, so a worker never blocks on sending.
                            scope.spawn(move |_| {
                                if !over.load(Ordering::Relaxed) {
                                    let caught = defect::caught(|| {
                                        run(task);
                                        Ok(())
                                    });
                                    drop(done.send((number, caught)));
                                }
                            });
                            started += 1;
                        }
                    }
                }
                if sunk == started {
                    return Ok(());
                }
                let (number, caught) = self.receive(&finished)?;
                waiting.insert(number, caught);
                while let Some(caught) = waiting.remove(&sunk) {
                    caught?;
                    end(sunk)?;
                    sunk += 1;
                }
            };
            let outcome = defect::caught(&mut pass);
            over.store(true, Ordering::Relaxed);
            outcome
        });
        self.between_steps();
        outcome
    }

    /// The next job that is done. Waiting ends when the flag is set, whatever the jobs do.
    fn receive(&self, finished: &Receiver<(usize, Result<()>)>) -> Result<(usize, Result<()>)> {
        loop {
            match finished.recv_timeout(LOOK) {
                Ok(job) => return Ok(job),
                Err(RecvTimeoutError::Timeout) => self.check_cancelled()?,
                Err(RecvTimeoutError::Disconnected) => {
                    return Err(Error::Internal("all jobs are gone, but not all results are there".into()));
                }
            }
        }
    }

    /// [`Workers::in_order`] over the numbers `0..jobs`.
    ///
    /// # Errors
    /// The same as [`Workers::in_order`].
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
impl Workers {
    /// Plants a panic: in the first source, job or sink (`part` 0, 1, 2) of pass `pass`.
    pub(crate) fn plant(&self, pass: usize, part: usize) {
        self.fault.plant(pass, part);
    }

    /// The passes that were begun since the last panic was planted.
    pub(crate) fn passes(&self) -> usize {
        self.fault.passes()
    }
}

#[cfg(test)]
mod fault {
    //! Panics for tests, in any part of any pass.

    use std::sync::atomic::{AtomicUsize, Ordering};

    #[derive(Debug)]
    pub(super) struct Fault {
        begun: AtomicUsize,
        pass: AtomicUsize,
        part: AtomicUsize,
    }

    impl Default for Fault {
        fn default() -> Fault {
            Fault { begun: AtomicUsize::new(0), pass: AtomicUsize::new(usize::MAX), part: AtomicUsize::new(0) }
        }
    }

    impl Fault {
        pub(super) fn plant(&self, pass: usize, part: usize) {
            self.part.store(part, Ordering::SeqCst);
            self.pass.store(pass, Ordering::SeqCst);
            self.begun.store(0, Ordering::SeqCst);
        }

        pub(super) fn passes(&self) -> usize {
            self.begun.load(Ordering::SeqCst)
        }

        /// What the next pass is to do.
        pub(super) fn of_next_pass(&self) -> Planted {
            let here = self.begun.fetch_add(1, Ordering::SeqCst) == self.pass.load(Ordering::SeqCst);
            Planted(here.then(|| self.part.load(Ordering::SeqCst)))
        }
    }

    /// A part of a pass.
    #[derive(Debug, Clone, Copy)]
    pub(super) enum Part {
        Source,
        Work,
        Sink,
    }

    /// The part of a pass that is to panic, if one is.
    pub(super) struct Planted(Option<usize>);

    impl Planted {
        pub(super) fn reach(&self, part: Part) {
            if self.0 == Some(part as usize) {
                // Without the hook: nobody needs to read of panics that a test wants.
                std::panic::resume_unwind(Box::new("planted"));
            }
        }
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    /// Whatever panics, wherever, the pass ends with an error, and the pool can be used again.
    #[test]
    fn a_panic_ends_the_pass_and_is_no_wait() {
        for in_flight in [1, 2, 4] {
            let workers = Workers::new(3).unwrap();
            for part in 0..3 {
                workers.plant(0, part);
                let error = workers.in_order_range(in_flight, 50, Ok, |_| Ok(())).unwrap_err();
                let Error::Internal(words) = &error else { panic!("{error}") };
                assert!(words.contains("planted"), "{words}");
            }
            let later = |i: usize| {
                assert!(i != 30, "job {i} is wrong");
                Ok(i)
            };
            let mut seen = 0;
            let error = workers.in_order_range(in_flight, 50, later, |i| {
                seen = i + 1;
                Ok(())
            });
            assert!(error.unwrap_err().to_string().contains("job 30 is wrong"));
            assert_eq!(seen, 30, "jobs before it are as they were");
            let mut sum = 0;
            let add = |i| {
                sum += i;
                Ok(())
            };
            workers.in_order_range(in_flight, 50, Ok, add).unwrap();
            assert_eq!(sum, 49 * 25);
        }
    }

    #[test]
    fn a_set_flag_is_seen_while_waiting_for_a_result() {
        let workers = Workers::new(1).unwrap();
        let (_held, results) = crossbeam_channel::bounded(1);
        workers.cancel_flag().store(true, Ordering::Relaxed);
        assert!(matches!(workers.receive(&results), Err(Error::Interrupted)));
    }

    #[test]
    fn a_worker_alone_is_the_calling_thread() {
        let outcome = std::thread::spawn(|| {
            let mut workers = Workers::new(1).unwrap();
            workers.alone = true;
            let here = std::thread::current().id();
            workers.in_order_range(
                8,
                9,
                |i| {
                    assert_eq!(std::thread::current().id(), here);
                    Ok(i)
                },
                |_| Ok(()),
            )
        });
        outcome.join().unwrap().unwrap();
    }

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
