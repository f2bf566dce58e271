//! States to the device and back.

use cubecl::prelude::*;
use rayon::prelude::*;

use super::super::device::Device;
use super::super::layout::{NONE, REFER, RELIST, SLOTS, status};
use super::super::tables::status_row;
use super::Group;
use crate::state::{ContactMemory, Particles, Place, Progress, Spin, State, SurfaceMemory, Velocity};

/// Where particles stand in the order of storage.
struct Places(Vec<(u32, u32)>);

impl Places {
    fn of(ids: &[u32]) -> Self {
        let mut places: Vec<(u32, u32)> = ids.iter().zip(0..).map(|(id, i)| (*id, i)).collect();
        places.sort_unstable();
        Self(places)
    }

    fn get(&self, id: u32) -> Option<usize> {
        // Numbers have few gaps: most particles stand where theirs says.
        let guess = (id as usize).min(self.0.len().saturating_sub(1));
        let at = if self.0.get(guess)?.0 == id {
            guess
        } else {
            self.0.binary_search_by_key(&id, |(id, _)| *id).ok()?
        };
        Some(self.0[at].1 as usize)
    }
}

impl Group {
    /// Copies a state into the first halves of the world's columns; its lists are still to be made.
    pub(super) fn put<R: Runtime>(&mut self, device: &Device<R>, w: usize, state: &State) {
        let region = self.regions[w];
        let p = &state.particles;
        let n = p.len();
        let first = region.first as usize;
        self.counts[w] = n;
        let row = status_row(&state.progress, n);
        let at = w * status::WORDS as usize;
        self.states[at..at + row.len()].copy_from_slice(&row);
        self.set_state(w, status::ASKED, if state.progress.stale { REFER } else { RELIST });

        let bits = |x: [f32; 3]| x.map(f32::to_bits);
        let place: Vec<[u32; 4]> =
            p.place.iter().map(|x| [x.lo[0], x.lo[1], x.lo[2], x.radius.to_bits()]).collect();
        let vel: Vec<[f32; 4]> = p.velocity.iter().map(|x| [x.v[0], x.v[1], x.v[2], x.inv_mass]).collect();
        let spin: Vec<[u32; 4]> = p
            .spin
            .iter()
            .map(|x| {
                let [a, b, c] = bits(x.w);
                [a, b, c, x.material]
            })
            .collect();
        device.write(&self.b.place, first, &place);
        device.write(&self.b.vel, first, &vel);
        device.write(&self.b.spin, first, &spin);
        let own: Vec<[[u32; 4]; 2]> = (0..n)
            .map(|i| {
                let (h, r) = (p.hi[i].map(|x| x as u32), bits(p.rest[i]));
                [[h[0], h[1], h[2], p.id[i]], [r[0], r[1], r[2], 0]]
            })
            .collect();
        device.write(&self.b.own, 2 * first, own.as_flattened());
        let refs: Vec<[[u32; 4]; 2]> = (0..n)
            .map(|i| {
                let (l, h) = (p.lo_ref[i], p.hi_ref[i].map(|x| x as u32));
                [[l[0], l[1], l[2], p.place[i].radius.to_bits()], [h[0], h[1], h[2], p.id[i]]]
            })
            .collect();
        device.write(&self.b.refs, 2 * first, refs.as_flattened());
        let slow: Vec<[[f32; 4]; 3]> = (0..n)
            .map(|i| [p.acceleration[i], p.angular[i], p.force[i]].map(|x| [x[0], x[1], x[2], 0.0]))
            .collect();
        device.write(&self.b.slow, 3 * first, slow.as_flattened());
        let places = Places::of(&p.id);
        self.put_contacts(device, w, state, &places);
        self.put_surface_contacts(device, w, state, &places);
    }

    /// What pairs remember, kept until the first rebuild.
    fn put_contacts<R: Runtime>(&self, device: &Device<R>, w: usize, state: &State, places: &Places) {
        let first = self.regions[w].first;
        let (begin, room) = self.kept(w);
        let pair = |m: &ContactMemory| {
            let [a, b] = m.id.map(|id| places.get(id));
            Some([first + a? as u32, first + b? as u32])
        };
        let known = state.contacts.par_iter().filter_map(|m| Some((pair(m)?, m)));
        let (mut pairs, mut memories): (Vec<[u32; 2]>, Vec<&ContactMemory>) = known.unzip();
        // What does not fit goes with an attempt that fails: the lists to be made have no less in them.
        pairs.truncate(room);
        memories.truncate(room);
        device.write(&self.b.held, w, &[pairs.len() as u32]);
        device.write(&self.b.kept, 2 * begin, pairs.as_flattened());
        for q in 0..self.signature.quads() as usize {
            let plane: Vec<[f32; 4]> = memories.par_iter().map(|m| quad_of(&m.history, q)).collect();
            device.write(&self.b.kept_hist, self.kept_plane(q) + begin, &plane);
        }
    }

    fn put_surface_contacts<R: Runtime>(&self, device: &Device<R>, w: usize, state: &State, places: &Places) {
        let region = &self.regions[w];
        let n = state.particles.len();
        let mut row_of = vec![NONE; n];
        let (mut counts, mut memory) = (Vec::new(), Vec::<[f32; 4]>::new());
        // What does not fit goes with an attempt that fails: the lists to be made have no less in them.
        for same in state.surface_contacts.chunk_by(|a, b| a.id == b.id) {
            let Some(i) = places.get(same[0].id) else { continue };
            if counts.len() as u32 == region.rooms.rows {
                break;
            }
            row_of[i] = region.begins[1] + counts.len() as u32;
            counts.push(same.len().min(SLOTS as usize) as u32);
            let wide = self.signature.row_quads() as usize;
            let mut slots = vec![[0.0_f32; 4]; wide * SLOTS as usize];
            for (k, m) in same.iter().take(SLOTS as usize).enumerate() {
                slots[wide * k] = [m.n[0], m.n[1], m.n[2], m.surface as f32];
                (1..wide).for_each(|q| slots[wide * k + q] = quad_of(&m.history, q - 1));
            }
            memory.extend(slots);
        }
        device.write(&self.b.rows, region.first as usize, &row_of);
        device.write(&self.b.row_count, region.begins[1] as usize, &counts);
        device.write(
            &self.b.row_mem,
            (region.begins[1] * SLOTS * self.signature.row_quads()) as usize,
            &memory,
        );
    }

    /// The complete state of a world.
    pub(super) fn state<R: Runtime>(&self, device: &Device<R>, w: usize, g: &Progress) -> State {
        let particles = self.particles(device, w);
        if device.broken().is_some() {
            return State { progress: g.clone(), ..State::default() };
        }
        let contacts = self.contacts(device, w, &particles);
        let surface_contacts = self.surface_contacts(device, w, &particles);
        State { particles, contacts, surface_contacts, progress: g.clone() }
    }

    /// The particles of a world.
    pub(super) fn particles<R: Runtime>(&self, device: &Device<R>, w: usize) -> Particles {
        let region = &self.regions[w];
        let n = self.counts[w];
        let first = region.first as usize;
        let padded = self.padded as usize;
        let parity = self.state_word(w, status::PARITY) as usize;
        let listed = self.state_word(w, status::LISTED) as usize;
        let b = &self.b;
        let float = |q: u32| f32::from_bits(q);
        let place: Vec<[u32; 4]> = device.read(&b.place, parity * padded + first, n);
        let vel: Vec<[f32; 4]> = device.read(&b.vel, parity * padded + first, n);
        let spin: Vec<[u32; 4]> = device.read(&b.spin, parity * padded + first, n);
        let own: Vec<[u32; 4]> = device.read(&b.own, 2 * (listed * padded + first), 2 * n);
        let refs: Vec<[u32; 4]> = device.read(&b.refs, 2 * (listed * padded + first), 2 * n);
        let slow: Vec<[f32; 4]> = device.read(&b.slow, 3 * (listed * padded + first), 3 * n);
        if device.broken().is_some() {
            return Particles::default();
        }
        let three = |q: &[f32; 4]| [q[0], q[1], q[2]];
        let whole = |q: &[u32; 4]| [q[0] as i32, q[1] as i32, q[2] as i32];
        let floats = |q: &[u32; 4]| [float(q[0]), float(q[1]), float(q[2])];
        Particles {
            id: own.iter().step_by(2).map(|h| h[3]).collect(),
            place: place.iter().map(|x| Place { lo: [x[0], x[1], x[2]], radius: float(x[3]) }).collect(),
            velocity: vel.iter().map(|v| Velocity { v: three(v), inv_mass: v[3] }).collect(),
            spin: spin.iter().map(|s| Spin { w: floats(s), material: s[3] }).collect(),
            hi: own.iter().step_by(2).map(whole).collect(),
            rest: own.iter().skip(1).step_by(2).map(floats).collect(),
            acceleration: slow.iter().step_by(3).map(three).collect(),
            angular: slow.iter().skip(1).step_by(3).map(three).collect(),
            force: slow.iter().skip(2).step_by(3).map(three).collect(),
            lo_ref: refs.iter().step_by(2).map(|l| [l[0], l[1], l[2]]).collect(),
            hi_ref: refs.iter().skip(1).step_by(2).map(whole).collect(),
        }
    }

    /// Keeps what the pairs of a world remember aside of its lists.
    pub(super) fn keep_touching<R: Runtime>(&self, device: &Device<R>, w: usize) {
        device.write(&self.b.held, w, &[0_u32]);
        self.keep(device, w as u32);
    }

    fn contacts<R: Runtime>(&self, device: &Device<R>, w: usize, p: &Particles) -> Vec<ContactMemory> {
        let first = self.regions[w].first as usize;
        let (begin, _) = self.kept(w);
        let b = &self.b;
        self.keep_touching(device, w);
        let held = device.read::<u32>(&b.held, w, 1).into_iter().sum::<u32>() as usize;
        let pairs: Vec<u32> = device.read(&b.kept, 2 * begin, 2 * held);
        let planes: Vec<Vec<[f32; 4]>> = (0..self.signature.quads() as usize)
            .map(|q| device.read(&b.kept_hist, self.kept_plane(q) + begin, held))
            .collect();
        if device.broken().is_some() {
            return Vec::new();
        }
        let h = self.worlds[w].history.len();
        let pairs = pairs.par_chunks_exact(2).enumerate();
        let mut contacts: Vec<ContactMemory> = pairs
            .map(|(k, pair)| ContactMemory {
                id: [pair[0], pair[1]].map(|i| p.id[i as usize - first]),
                history: planes.iter().flat_map(|plane| plane[k]).take(h).collect(),
            })
            .collect();
        contacts.par_sort_unstable_by_key(|m| m.id);
        contacts
    }

    fn surface_contacts<R: Runtime>(
        &self,
        device: &Device<R>,
        w: usize,
        p: &Particles,
    ) -> Vec<SurfaceMemory> {
        if !self.signature.surfaces {
            return Vec::new();
        }
        let (c, region) = (&self.worlds[w], &self.regions[w]);
        let b = &self.b;
        let parity = self.state_word(w, status::PARITY) as usize;
        let listed = self.state_word(w, status::LISTED) as usize;
        let (n, begin) = (p.len(), region.begins[1] as usize);
        let row_of: Vec<u32> = device.read(&b.rows, listed * self.padded as usize + region.first as usize, n);
        if device.broken().is_some() {
            return Vec::new();
        }
        let used = row_of.iter().filter(|r| **r != NONE).map(|r| *r as usize + 1 - begin).max().unwrap_or(0);
        let half = parity * self.rooms[1] as usize;
        let counts: Vec<u32> = device.read(&b.row_count, half + begin, used);
        let wide = self.signature.row_quads() as usize;
        let row_quads = wide * SLOTS as usize;
        let memory: Vec<[f32; 4]> = device.read(&b.row_mem, (half + begin) * row_quads, used * row_quads);
        let h = c.history.len();
        let mut found = Vec::new();
        for (i, row) in row_of.iter().enumerate().filter(|(_, r)| **r != NONE) {
            let row = *row as usize - begin;
            for k in 0..counts[row] as usize {
                let at = wide * (row * SLOTS as usize + k);
                let m = memory[at];
                found.push(SurfaceMemory {
                    id: p.id[i],
                    surface: m[3] as u32,
                    n: [m[0], m[1], m[2]],
                    history: memory[at + 1..at + wide].iter().flatten().take(h).copied().collect(),
                });
            }
        }
        found.sort_by_key(|m| (m.id, m.surface));
        found
    }
}

/// Quad `q` of what a contact remembers.
fn quad_of(history: &[f32], q: usize) -> [f32; 4] {
    std::array::from_fn(|k| history.get(4 * q + k).copied().unwrap_or_default())
}
