//! Steps of worlds, as far as the host looks ahead, and what becomes of them.

use std::time::Instant;

use cubecl::prelude::*;
use glebe_physics::IntegratorKind;

use super::super::device::Device;
use super::super::fault::Fault;
use super::super::layout::{BLOCK, NONE, PERIOD, SLOTS, SUMS, flag, halt, status};
use super::super::step::Purpose;
use super::{CROWD, Cut, Group, Lack, Report, STRETCH};
use crate::backend::Job;
use crate::backend::common::{
    Portrait, leavers, narrow_failure, overlap_failure, runaway_failure, too_deep, unload,
};
use crate::cell::too_narrow;
use crate::failure::Failure;
use crate::setup::Constants;
use crate::state::{Progress, State};

/// Stretches of so few steps are attended: lists are rebuilt only when they have to be.
const ATTENDED: u64 = 16;

impl Group {
    /// Lets the servos act that are due.
    fn govern<R: Runtime>(&mut self, device: &Device<R>, jobs: &mut [(usize, &mut Job<'_>)], left: &[u64]) {
        let due: Vec<usize> = (0..jobs.len())
            .filter(|&k| left[k] > 0 && self.worlds[jobs[k].0].governs(jobs[k].1.progress))
            .collect();
        if due.is_empty() {
            return;
        }
        let asked: Vec<(usize, &Progress)> = due.iter().map(|&k| (jobs[k].0, &*jobs[k].1.progress)).collect();
        let seen = self.observe(device, &asked);
        for (k, moment) in due.into_iter().zip(seen) {
            let (w, job) = &mut jobs[k];
            self.worlds[*w].govern(job.progress, moment.tensors.as_ref());
        }
    }

    /// One stretch of steps of every job.
    pub(super) fn stretch<R: Runtime>(
        &mut self,
        device: &Device<R>,
        jobs: &mut [(usize, &mut Job<'_>)],
        left: &mut [u64],
    ) {
        let began = Instant::now();
        self.govern(device, jobs, left);
        let mut asked: Vec<Option<(&Progress, u64, bool)>> = vec![None; self.worlds.len()];
        let mut tasks = vec![0; self.worlds.len()];
        let (mut longest, mut follows) = (0, false);
        for w in 0..self.worlds.len() {
            self.set_state(w, status::BASE, 0);
            self.set_state(w, status::TARGET, 0);
            self.set_state(w, status::REBUILDS, 0);
            self.set_state(w, status::REBUILT, NONE);
        }
        for ((w, job), n) in jobs.iter().zip(left.iter()) {
            let whole = || {
                let most = (*n).min(STRETCH).min(self.worlds[*w].steps_governed(job.progress));
                steps_ahead(&self.worlds[*w], job.progress, most)
            };
            let steps = self.cut[*w].as_ref().map_or_else(whole, |cut| cut.steps);
            tasks[*w] = steps;
            self.states[*w * status::WORDS as usize + status::TARGET as usize] = steps as u32;
            longest = longest.max(steps);
            asked[*w] = Some((&*job.progress, steps, false));
            follows |= job.progress.surfaces.iter().any(|s| s.present);
        }
        self.follows = follows;
        let astray = self.prepare(device, &asked);
        if !astray.is_empty() {
            for ((w, job), left) in
                jobs.iter_mut().zip(left.iter_mut()).filter(|((w, _), _)| astray.contains(w))
            {
                *left = 0;
                let g = &job.progress;
                job.outcome = Err(Failure {
                    time: g.step as f64 * self.worlds[*w].dt,
                    step: g.step,
                    what: "a mesh is more than 500 periods away from the cell".to_owned(),
                    cause: "on a device images of particles are told within 500 periods; let the tool turn back, \
                            or run with --device cpu"
                        .to_owned(),
                });
            }
            return;
        }
        self.b.sums = device.zeros(self.blocks() * SUMS as usize * 2, 4);
        for w in 0..self.worlds.len() {
            if let Some(cut) = self.cut[w].take() {
                let places = self.sums_of(w);
                places
                    .iter()
                    .zip(&cut.sums)
                    .for_each(|((at, _), sums)| device.write(&self.b.sums, *at, sums));
            }
        }
        if device.broken().is_some() {
            return;
        }
        let split = self.signature.integrator == IntegratorKind::VelocityVerlet;
        if split && jobs.iter().any(|(_, j)| !j.progress.primed) {
            self.look(device, Purpose::Prime);
        }
        let mut report;
        let mut left_over = longest as u32;
        let attended = longest <= ATTENDED;
        let mut idle = 0;
        loop {
            let mut kept = None;
            // Groups end where lists do.
            let left_at_start = left_over;
            let age = jobs.iter().map(|(w, _)| self.state_word(*w, status::SINCE)).max().unwrap_or(0);
            let mut next = self.launches.min(PERIOD.saturating_sub(age).max(1));
            while left_over > 0 {
                let k = next.min(left_over).min(self.held);
                next = self.launches;
                for launch in 0..k {
                    self.step(device, launch);
                }
                if self.follows {
                    self.collect(device, k);
                }
                self.begin(device, k);
                left_over = left_over.saturating_sub(k);
                kept = attended.then(|| self.fetch(device)).filter(|report| !self.rebuilding(report));
                if kept.is_none() {
                    self.rebuild(device);
                }
            }
            report = match kept {
                Some(report) => report,
                None => self.fetch(device),
            };
            let open = (0..self.worlds.len())
                .map(|w| self.state_word(w, status::TARGET).saturating_sub(self.state_word(w, status::BASE)))
                .max()
                .unwrap_or(0);
            if open == 0 || device.broken().is_some() {
                break;
            }
            // A round may end in new lists alone; several in a row have done nothing.
            idle = if open == left_at_start { idle + 1 } else { 0 };
            if idle == 3 {
                device.breaks(Fault::refused(
                    "it runs no step: its driver refused a kernel or dropped launches",
                ));
                break;
            }
            left_over = open;
        }
        let rebuilds =
            (0..self.worlds.len()).map(|w| self.state_word(w, status::REBUILDS)).max().unwrap_or(0);
        // How long groups are decides how much is done in vain, never what comes out. They end where the lists of one
        // world do. Of many, whose lists end at all times, each waits half a group for new ones, but short groups end in
        // rebuilds that few of them need.
        let lasts = (longest as u32).checked_div(rebuilds).unwrap_or(PERIOD).min(PERIOD);
        self.launches = if jobs.len() < CROWD { lasts.max(8) } else { (3 * lasts.isqrt()).max(4) };
        self.finish(device, jobs, left, &tasks, &report, split);
        self.times.device += began.elapsed().as_secs_f64();
    }

    /// Takes the outcome of a stretch of so many steps of each world over into the worlds' progress.
    fn finish<R: Runtime>(
        &mut self,
        device: &Device<R>,
        jobs: &mut [(usize, &mut Job<'_>)],
        left: &mut [u64],
        tasks: &[u64],
        report: &Report,
        split: bool,
    ) {
        if device.broken().is_some() {
            return;
        }
        let Report { flags, sums, series } = report;
        let mut stopped = Vec::new();
        for ((w, job), left) in jobs.iter_mut().zip(left.iter_mut()) {
            let c = self.worlds[*w].clone();
            let w = *w;
            let done = u64::from(self.state_word(w, status::BASE));
            let beats = u64::from(flags[w * flag::WORDS as usize + flag::BEATS as usize]);
            if beats != done {
                device.breaks(Fault::refused(format!(
                    "{beats} of {done} steps were run: its driver refused a kernel or dropped launches"
                )));
                return;
            }
            let g = &mut *job.progress;
            let begin = g.step;
            let surfaces = c.spec.surfaces.len();
            for t in 0..done as usize {
                g.step += u64::from(split);
                let forces: Vec<[f64; 6]> = (0..surfaces)
                    .map(|s| {
                        let from = self.series_at[w] + (t * surfaces + s) * 12;
                        std::array::from_fn(|q| {
                            f64::from(series[from + 2 * q]) + f64::from(series[from + 2 * q + 1])
                        })
                    })
                    .collect();
                g.account(&c, &forces);
                g.step += u64::from(!split);
            }
            g.primed |= done > 0;
            *left -= done;
            let f = &flags[w * flag::WORDS as usize..(w + 1) * flag::WORDS as usize];
            if f[flag::HALT as usize] == halt::ROOM && done < tasks[w] {
                let sums = self.sums_of(w).map(|(at, len)| device.read(&self.b.sums, at, len));
                self.cut[w] = Some(Cut { done, steps: tasks[w] - done, sums });
            } else {
                self.book(w, sums, g, done);
            }
            g.bonds.broken += u64::from(f[flag::BROKEN as usize]);
            let rebuilt = self.state_word(w, status::REBUILT);
            g.skin = f64::from(f32::from_bits(self.state_word(w, status::SKIN)));
            g.rebuilds += u64::from(self.state_word(w, status::REBUILDS));
            let now = g.step;
            for t in 0..=done {
                if t > 0
                    && let Some(cell) = &mut g.cell
                {
                    cell.step(c.dt);
                }
                if t == u64::from(rebuilt) {
                    g.step = begin + t;
                    g.refer(&c);
                }
            }
            g.step = now;
            self.last[w] = g.clone();
            let worst = f64::from(f32::from_bits(f[flag::WORST as usize]));
            let deep = too_deep(&c, g, worst);
            match f[flag::HALT as usize] {
                halt::NO => {
                    job.outcome = narrow_failure(&c, g, &c.lattice_now(g));
                    *left = if job.outcome.is_ok() { *left } else { 0 };
                }
                halt::LEFT | halt::ROOM => stopped.push(w),
                why => {
                    *left = 0;
                    let progress = g.clone();
                    job.outcome =
                        Err(self.failure(device, w, &progress, f[flag::WHO as usize], why, deep, worst));
                }
            }
        }
        for w in stopped {
            if let Some((_, job)) = jobs.iter_mut().find(|(k, _)| *k == w) {
                self.relieve(device, w, job.progress, report);
            }
        }
    }

    /// Takes out the particles that left a world, or takes more memory, and makes its lists again.
    fn relieve<R: Runtime>(&mut self, device: &Device<R>, w: usize, g: &mut Progress, report: &Report) {
        let c = self.worlds[w].clone();
        let before = self.observe(device, &[(w, g)]).pop().unwrap_or_default();
        let mut state = self.state(device, w, g);
        let keep = leavers(&c, &state.particles, &mut state.progress);
        let leave = keep.contains(&false);
        if leave && let Some(cut) = self.cut[w].take() {
            // Stretches end where particles leave, whatever there is room for.
            self.book(w, &report.sums, &mut state.progress, cut.done);
        }
        state.remove(&keep);
        state.progress.stale = true;
        if leave && self.signature.integrator == IntegratorKind::VelocityVerlet {
            // The next step begins with the acceleration of this one, which those that left had a part in.
            state.progress.primed = false;
        }
        let needs = Self::needs(&report.flags).unwrap_or_default();
        // Another world's need may have been met with its own meanwhile.
        let held = self.regions[w].rooms;
        let lacks =
            |[lists, rows, facets]: [u32; 3]| lists > held.lists || rows > held.rows || facets > held.facets;
        let needs: Vec<Lack> = needs.into_iter().filter(|(k, need)| *k == w && lacks(*need)).collect();
        if needs.is_empty() {
            self.put(device, w, &state);
            if let Some(needs) = self.relist(device, &mut [(w, &mut state.progress)]) {
                self.regrow(device, needs, w, &mut state);
            }
        } else {
            self.regrow(device, needs, w, &mut state);
        }
        if leave {
            let after = self.observe(device, &[(w, &state.progress)]).pop().unwrap_or_default();
            let gone = [
                before.elastic_normal - after.elastic_normal,
                before.elastic_tangential - after.elastic_tangential,
            ];
            unload(&mut state.progress, gone);
        }
        *g = state.progress;
    }

    /// Whether any world rebuilds, or stopped.
    fn rebuilding(&self, report: &Report) -> bool {
        (0..self.worlds.len()).any(|w| {
            self.state_word(w, status::REBUILDING) == 1
                || report.flags[w * flag::WORDS as usize + flag::HALT as usize] != halt::NO
        })
    }

    /// Where the sums of a world's blocks are, of particles and of those near surfaces: first word, words.
    fn sums_of(&self, w: usize) -> [(usize, usize); 2] {
        let (s, region) = (self.signature, &self.regions[w]);
        let words = |blocks: usize| if s.ledger { blocks * SUMS as usize * 2 } else { 0 };
        let [first, padded] = [region.first, self.padded].map(|n| words(s.blocks(n as usize, 0)));
        let [begin, near] = [region.begins[1], region.rooms.rows].map(|n| words(s.blocks(0, n as usize)));
        [(first, words(s.blocks((region.blocks * BLOCK) as usize, 0))), (padded + begin, near)]
    }

    /// Dissipation and work of a stretch.
    fn book(&self, w: usize, sums: &[f32], g: &mut Progress, done: u64) {
        if !self.signature.ledger || done == 0 {
            return;
        }
        let mut total = [0.0_f64; SUMS as usize];
        for (q, sum) in total.iter_mut().enumerate() {
            let at = (w * SUMS as usize + q) * 2;
            *sum = f64::from(sums[at]) + f64::from(sums[at + 1]);
        }
        let [friction, dash, roll, damped, work, before, tangential, last] = total;
        let l = &mut g.ledger;
        l.friction += friction;
        l.dashpots += dash;
        l.rolling += roll;
        l.damping += damped;
        l.work += work;
        l.stiffness_change += l.elastic_tangential + (tangential - last) - before;
        l.elastic_tangential = last;
    }

    fn failure<R: Runtime>(
        &self,
        device: &Device<R>,
        w: usize,
        g: &Progress,
        who: u32,
        why: u32,
        deep: bool,
        worst: f64,
    ) -> Failure {
        let c = &self.worlds[w];
        let state = self.state(device, w, g);
        let describe = |id: u32| state.describe(c, id);
        if why == halt::CONTACTS {
            return Failure {
                time: g.step as f64 * c.dt,
                step: g.step,
                what: format!("{} touches more than {SLOTS} walls of surfaces at once", describe(who)),
                cause:
                    "the GPU backend holds no more contacts of one particle; coarsen the mesh or run with \
                        --device cpu"
                        .to_owned(),
            };
        }
        if deep && why == halt::OVERLAP {
            return overlap_failure(c, g, &describe(who), "its neighbour", worst);
        }
        let i = state.particles.id.iter().position(|&id| id == who);
        let v = i.map_or([f64::NAN; 3], |i| state.particles.velocity[i].v.map(f64::from));
        runaway_failure(c, g, &describe(who), v)
    }
}

/// Steps of `most` until the cell has become too narrow.
fn steps_ahead(c: &Constants, g: &Progress, most: u64) -> u64 {
    let Some(mut cell) = g.cell else { return most };
    let narrow = (1..most).find(|_| {
        cell.step(c.dt);
        too_narrow(&c.lattice.deformed(&cell.matrix), c.cutoff()).is_some()
    });
    narrow.unwrap_or(most)
}

impl State {
    /// Particle `id` in words: number, place, speed, contacts.
    fn describe(&self, c: &Constants, id: u32) -> String {
        let Some(i) = self.particles.id.iter().position(|&k| k == id) else {
            return format!("particle {id}");
        };
        let pairs = self.contacts.iter().filter(|m| m.id.contains(&id));
        let mut with: Vec<String> =
            pairs.map(|m| (if m.id[0] == id { m.id[1] } else { m.id[0] }).to_string()).collect();
        let surfaces = self.surface_contacts.iter().filter(|m| m.id == id);
        with.extend(surfaces.map(|m| format!("`{}`", c.boundaries[m.surface as usize].name)));
        Portrait::of(&c.lattice_now(&self.progress), &self.particles, i).describe(with)
    }
}
