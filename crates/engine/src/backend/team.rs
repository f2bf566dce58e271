//! Threads for the short parts of a step. A step of some thousand particles has parts of a tenth of a millisecond; threads
//! that fall asleep between them, as those of a pool do, take as long to wake. Those of a team stay awake for a while.

use std::hint::spin_loop;
use std::sync::atomic::{AtomicPtr, AtomicUsize, Ordering};
use std::sync::{Mutex, OnceLock};
use std::thread::{self, Thread};

use rayon::prelude::*;

/// Looks at what there is to do before a helper falls asleep: some tens of microseconds.
const PATIENCE: u32 = 4000;
/// No part is under way.
const CLOSED: usize = 0;
/// There will be no more parts.
const OVER: usize = usize::MAX;

type Task<'a> = &'a (dyn Fn(usize) + Sync);

/// A thread that steps a world, and its helpers.
pub struct Team {
    /// The next item of each member's share, apart from each other.
    next: Vec<Apart>,
    /// Items of the part under way.
    items: AtomicUsize,
    /// What is done with an item, as a pointer to a [`Task`].
    task: AtomicPtr<()>,
    /// Number of the part under way.
    open: AtomicUsize,
    /// Parts so far.
    parts: AtomicUsize,
    /// Helpers that may be using the task.
    busy: AtomicUsize,
    /// Helpers that are falling asleep or do.
    asleep: AtomicUsize,
    helpers: OnceLock<Vec<Thread>>,
}

#[derive(Default)]
#[repr(align(128))]
struct Apart(AtomicUsize);

impl Team {
    fn of(members: usize) -> Self {
        Self {
            next: (0..members).map(|_| Apart::default()).collect(),
            items: AtomicUsize::new(0),
            task: AtomicPtr::default(),
            open: AtomicUsize::new(CLOSED),
            parts: AtomicUsize::new(0),
            busy: AtomicUsize::new(0),
            asleep: AtomicUsize::new(0),
            helpers: OnceLock::new(),
        }
    }

    /// Nobody: work goes to the threads of the pool.
    pub fn nobody() -> Self {
        Self::of(0)
    }

    /// A team of so many at work, this thread included; threads that cannot be had are done without.
    pub fn at_work<R>(members: usize, work: impl FnOnce(&Self) -> R) -> R {
        if members < 2 {
            return work(&Self::nobody());
        }
        let team = Self::of(members);
        thread::scope(|scope| {
            let team = &team;
            let _over = Over(team);
            let started = (1..members)
                .map_while(|m| thread::Builder::new().spawn_scoped(scope, move || team.help(m)).ok());
            let helpers = started.map(|handle| handle.thread().clone()).collect();
            let _ = team.helpers.set(helpers);
            work(team)
        })
    }

    /// Does something with each item, on as many threads as pay; `few` items are not worth waking any for.
    pub fn each<T: Send>(&self, items: Vec<T>, few: usize, work: impl Fn(T) + Sync) {
        if self.next.is_empty() || items.len() < few {
            let least = if items.len() < few { few } else { 1 };
            items.into_par_iter().with_min_len(least).for_each(&work);
            return;
        }
        let items: Vec<Mutex<Option<T>>> = items.into_iter().map(|item| Mutex::new(Some(item))).collect();
        let take = |k: usize| {
            let item = items[k].lock().ok().and_then(|mut item| item.take());
            item.into_iter().for_each(&work);
        };
        self.part(items.len(), &take);
    }

    fn part(&self, items: usize, task: Task<'_>) {
        for (member, next) in self.next.iter().enumerate() {
            next.0.store(self.share(member, items), Ordering::Relaxed);
        }
        self.items.store(items, Ordering::Relaxed);
        self.task.store((&raw const task).cast_mut().cast(), Ordering::Relaxed);
        let number = self.parts.fetch_add(1, Ordering::Relaxed) + 1;
        self.open.store(number, Ordering::SeqCst);
        // Whatever happens, nobody uses the task after this.
        let _closed = Closed(self);
        self.wake();
        self.take_part(0, items, task);
    }

    /// Where the share of a member begins.
    fn share(&self, member: usize, items: usize) -> usize {
        member * items / self.next.len()
    }

    /// Items of the own share, then what is left of the others'.
    fn take_part(&self, member: usize, items: usize, task: Task<'_>) {
        let members = self.next.len();
        for whose in (0..members).map(|k| (member + k) % members) {
            let end = self.share(whose + 1, items);
            loop {
                let k = self.next[whose].0.fetch_add(1, Ordering::Relaxed);
                if k >= end {
                    break;
                }
                task(k);
            }
        }
    }

    fn wake(&self) {
        if self.asleep.load(Ordering::SeqCst) > 0 {
            self.helpers.get().into_iter().flatten().for_each(Thread::unpark);
        }
    }

    /// What a helper does until the team is at work no more.
    fn help(&self, member: usize) {
        let mut done = CLOSED;
        let mut idle = 0;
        loop {
            let open = self.open.load(Ordering::Acquire);
            if open == OVER {
                return;
            }
            if open != CLOSED && open != done {
                self.busy.fetch_add(1, Ordering::SeqCst);
                let _free = Free(self);
                if self.open.load(Ordering::SeqCst) == open {
                    // SAFETY: the part is open and this helper is counted as busy, so `part` has not returned and what it
                    // points to is alive; it was stored before the part was opened.
                    #[allow(unsafe_code)]
                    let task = unsafe { *self.task.load(Ordering::Relaxed).cast::<Task<'_>>() };
                    self.take_part(member, self.items.load(Ordering::Relaxed), task);
                    done = open;
                }
                idle = 0;
            } else if idle < PATIENCE {
                idle += 1;
                spin_loop();
            } else {
                self.asleep.fetch_add(1, Ordering::SeqCst);
                let now = self.open.load(Ordering::SeqCst);
                if now == CLOSED || now == done {
                    thread::park();
                }
                self.asleep.fetch_sub(1, Ordering::SeqCst);
                idle = 0;
            }
        }
    }
}

/// Ends a part: waits until no helper uses its task.
struct Closed<'a>(&'a Team);

impl Drop for Closed<'_> {
    fn drop(&mut self) {
        self.0.open.store(CLOSED, Ordering::SeqCst);
        let mut looks = 0;
        while self.0.busy.load(Ordering::SeqCst) > 0 {
            looks += 1;
            // Where there are more threads than processors the helper may be waiting for this one's.
            if looks < PATIENCE { spin_loop() } else { thread::yield_now() }
        }
    }
}

/// A helper is busy no more.
struct Free<'a>(&'a Team);

impl Drop for Free<'_> {
    fn drop(&mut self) {
        self.0.busy.fetch_sub(1, Ordering::SeqCst);
    }
}

/// Sends the helpers home.
struct Over<'a>(&'a Team);

impl Drop for Over<'_> {
    fn drop(&mut self) {
        self.0.open.store(OVER, Ordering::SeqCst);
        self.0.helpers.get().into_iter().flatten().for_each(Thread::unpark);
    }
}

#[cfg(test)]
mod tests {
    use super::*;

    #[test]
    fn every_item_is_done_once_whoever_does_it() {
        for members in [0, 1, 2, 3, 7] {
            let sum = Team::at_work(members, |team| {
                let sum = AtomicUsize::new(0);
                for part in 0..300 {
                    if part % 100 == 50 {
                        thread::sleep(std::time::Duration::from_millis(2));
                    }
                    let items: Vec<usize> = (0..part % 37).collect();
                    team.each(items, 4, |k| {
                        sum.fetch_add(k + 1, Ordering::Relaxed);
                    });
                }
                sum.into_inner()
            });
            let all: usize = (0..300).map(|part| (0..part % 37).map(|k| k + 1).sum::<usize>()).sum();
            assert_eq!(sum, all, "{members} members");
        }
    }

    #[test]
    fn a_panic_of_any_member_ends_the_team() {
        for culprit in [0, 9] {
            let ended = std::panic::catch_unwind(|| {
                Team::at_work(3, |team| {
                    team.each((0..10).collect(), 4, |k| {
                        thread::sleep(std::time::Duration::from_millis(1));
                        assert_ne!(k, culprit);
                    });
                });
            });
            assert!(ended.is_err());
        }
    }
}
