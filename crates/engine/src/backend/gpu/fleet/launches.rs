//! What is launched: steps, looks, sums and rebuilds.

use cubecl::prelude::*;
use glebe_physics::IntegratorKind;

use super::super::device::{Buffer, Device, grid};
use super::super::launch::{Arguments, settings};
use super::super::layout::{BLOCK, NONE, SLICE, SUMS};
use super::super::step::Purpose;
use super::super::tables::leaves;
use super::super::{grades, keep, lists, rows, scan, search, step, sums, surfaces};
use super::{Group, Report};

impl Group {
    /// Reads states, flags, and what steps have left.
    pub(super) fn fetch<R: Runtime>(&mut self, device: &Device<R>) -> Report {
        if self.signature.ledger {
            self.over_blocks(device, SUMS, true, &self.b.sums);
        }
        let b = &self.b;
        let mut all = device.read_all(&[&b.states, &b.flags, &b.gathered, &b.series]).into_iter();
        device.settle();
        self.states = all.next().unwrap_or_default();
        let [flags, sums, series] = std::array::from_fn(|_| all.next().unwrap_or_default());
        let floats = |words: Vec<u32>| words.into_iter().map(f32::from_bits).collect();
        Report { flags, sums: floats(sums), series: floats(series) }
    }

    /// Sums over the blocks of each world.
    pub(super) fn over_blocks<R: Runtime>(
        &self,
        device: &Device<R>,
        quantities: u32,
        pairs: bool,
        blocks: &Buffer,
    ) {
        let worlds = self.worlds.len();
        // SAFETY: the kernel stays within the blocks of the worlds, for which the buffers were laid out.
        #[allow(unsafe_code)]
        unsafe {
            sums::over_blocks::launch_unchecked::<R>(
                device.client(),
                grid(worlds * quantities as usize),
                CubeDim::new_1d(BLOCK),
                worlds as u32,
                self.padded / self.signature.shape.owners,
                self.b.worlds.arg(),
                blocks.arg(),
                self.b.gathered.arg(),
                quantities,
                pairs,
                self.signature,
            );
        }
    }

    pub(super) fn step<R: Runtime>(&self, device: &Device<R>, k: u32) {
        let b = &self.b;
        let blocks = (self.padded / BLOCK) as usize;
        let split = self.signature.integrator == IntegratorKind::VelocityVerlet;
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if split {
                step::drift::launch_unchecked::<R>(
                    device.client(),
                    grid(blocks),
                    CubeDim::new_1d(BLOCK),
                    k,
                    self.padded,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.flags.arg(),
                    b.place.arg(),
                    b.vel.arg(),
                    b.spin.arg(),
                    b.own.arg(),
                    b.refs.arg(),
                    b.slow.arg(),
                    self.signature,
                );
            }
        }
        self.launch_step(device, k, Purpose::Step, &b.sums);
    }

    /// Sums the forces on surfaces of the steps of a group.
    pub(super) fn collect<R: Runtime>(&self, device: &Device<R>, launches: u32) {
        let b = &self.b;
        let span = self.signature.rows_of_block() as u32;
        // SAFETY: the kernel stays within the worlds and the launches that `push` was laid out for.
        #[allow(unsafe_code)]
        unsafe {
            step::collect::launch_unchecked::<R>(
                device.client(),
                grid(self.worlds.len() * launches as usize),
                CubeDim::new_1d(BLOCK),
                launches,
                self.worlds.len() as u32,
                self.rooms[1] / span,
                self.rooms[1],
                self.names,
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.push.arg(),
                b.series.arg(),
                span,
            );
        }
    }

    /// Blocks of a step.
    pub(super) fn blocks(&self) -> usize {
        self.signature.blocks(self.padded as usize, self.rooms[1] as usize)
    }

    fn launch_step<R: Runtime>(&self, device: &Device<R>, k: u32, purpose: Purpose, sums: &Buffer) {
        let b = &self.b;
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if self.signature.told {
                surfaces::tell::launch_unchecked::<R>(
                    device.client(),
                    grid((self.rooms[2] / BLOCK) as usize),
                    CubeDim::new_1d(BLOCK),
                    k,
                    self.padded,
                    self.rooms[1],
                    self.rooms[2],
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.flags.arg(),
                    b.place.arg(),
                    b.own.arg(),
                    b.refs.arg(),
                    b.bounds.arg(),
                    b.poses.arg(),
                    b.tris.arg(),
                    b.verts.arg(),
                    b.rows.arg(),
                    b.facets.arg(),
                    b.told.arg(),
                    self.signature,
                    purpose,
                );
            }
            if self.signature.surfaces && !self.signature.merged {
                let mut a = Arguments::of(&[k, self.padded, self.rooms[1], self.rooms[2], self.names]);
                let kernel = step::surfaces::Surfaces::<R>::new(
                    settings(BLOCK),
                    device.client().clone(),
                    (),
                    (),
                    (),
                    (),
                    (),
                    a.buffer(&b.world_of),
                    a.buffer(&b.worlds),
                    a.buffer(&b.states),
                    a.buffer(&b.flags),
                    a.buffer(&b.pairs),
                    a.buffer(&b.place),
                    a.buffer(&b.vel),
                    a.buffer(&b.spin),
                    a.buffer(&b.own),
                    a.buffer(&b.refs),
                    a.buffer(&b.bounds),
                    a.buffer(&b.poses),
                    a.buffer(&b.tris),
                    a.buffer(&b.verts),
                    a.buffer(&b.rows),
                    a.buffer(&b.facets),
                    a.buffer(&b.told),
                    a.buffer(&b.row_count),
                    a.buffer(&b.row_mem),
                    a.buffer(&b.push),
                    a.buffer(&b.row_sums),
                    self.signature,
                    purpose,
                );
                let blocks = grid((self.rooms[1] / BLOCK) as usize);
                a.launch_unchecked::<R, _>(device.client(), blocks, kernel, BLOCK, 0);
            }
            let mut a = Arguments::of(&[
                k,
                self.blocks() as u32,
                self.padded,
                self.rooms[0],
                self.rooms[1],
                self.rooms[2],
                self.names,
            ]);
            let kernel = step::step::Step::<R>::new(
                settings(self.signature.shape.units),
                device.client().clone(),
                (),
                (),
                (),
                (),
                (),
                (),
                (),
                a.buffer(&b.world_of),
                a.buffer(&b.worlds),
                a.buffer(&b.states),
                a.buffer(&b.flags),
                a.buffer(&b.pairs),
                a.buffer(&b.place),
                a.buffer(&b.vel),
                a.buffer(&b.spin),
                a.buffer(&b.own),
                a.buffer(&b.refs),
                a.buffer(&b.slow),
                a.buffer(&b.lists),
                a.buffer(&b.nbr),
                a.buffer(&b.hist),
                a.buffer(&b.bounds),
                a.buffer(&b.poses),
                a.buffer(&b.tris),
                a.buffer(&b.verts),
                a.buffer(&b.rows),
                a.buffer(&b.facets),
                a.buffer(&b.row_count),
                a.buffer(&b.row_mem),
                a.buffer(&b.push),
                a.buffer(&b.row_sums),
                a.buffer(sums),
                self.signature,
                purpose,
            );
            a.launch_unchecked::<R, _>(
                device.client(),
                grid(self.blocks()),
                kernel,
                self.signature.shape.units,
                self.signature.beside(),
            );
        }
    }

    /// Runs the contact phase on the present configuration.
    pub(super) fn look<R: Runtime>(&self, device: &Device<R>, purpose: Purpose) {
        self.launch_step(device, 0, purpose, &self.b.sights);
    }

    pub(super) fn sum<R: Runtime>(&self, device: &Device<R>, n: u32, input: &Buffer, out: &Buffer) {
        let tiles = n.div_ceil(scan::TILE);
        let totals = &self.b.totals;
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: the kernels check their bounds.
        #[allow(unsafe_code)]
        unsafe {
            scan::tiles::launch_unchecked::<R>(
                device.client(),
                grid(tiles as usize),
                dim,
                n,
                input.arg(),
                out.arg(),
                totals.arg(),
            );
            scan::join::launch_unchecked::<R>(device.client(), grid(1), dim, tiles, totals.arg());
            scan::spread::launch_unchecked::<R>(
                device.client(),
                grid((n as usize + 1).div_ceil(BLOCK as usize)),
                dim,
                n,
                tiles,
                totals.arg(),
                out.arg(),
            );
        }
    }

    /// Ends a group of `launches` steps: counts them and decides which worlds rebuild.
    pub(super) fn begin<R: Runtime>(&self, device: &Device<R>, launches: u32) {
        let worlds = self.worlds.len() as u32;
        // SAFETY: the kernel checks its bounds.
        #[allow(unsafe_code)]
        unsafe {
            lists::begin::launch_unchecked::<R>(
                device.client(),
                grid((worlds as usize).div_ceil(BLOCK as usize)),
                CubeDim::new_1d(BLOCK),
                launches,
                worlds,
                self.b.worlds.arg(),
                self.b.states.arg(),
                self.b.flags.arg(),
                self.b.held.arg(),
                self.signature.grids(),
            );
        }
    }

    /// Rebuilds the lists of the worlds that need it.
    pub(super) fn rebuild<R: Runtime>(&self, device: &Device<R>) {
        let b = &self.b;
        let (n, worlds) = (self.padded, self.worlds.len() as u32);
        let dim = CubeDim::new_1d(BLOCK);
        let by_world = || grid((worlds as usize).div_ceil(BLOCK as usize));
        let by_particle = || grid((n / BLOCK) as usize);
        let client = device.client();
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            lists::bin::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.place.arg(),
                b.own.arg(),
                b.refs.arg(),
                b.bins.arg(),
                b.counters.arg(),
                self.signature.grids(),
                self.signature.search,
            );
            self.sum(device, self.cells, &b.counters, &b.starts);
            lists::scatter::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.bins.arg(),
                b.starts.arg(),
                b.counters.arg(),
                b.order.arg(),
            );
            lists::sort::launch_unchecked::<R>(
                client,
                grid((self.cells / BLOCK) as usize),
                dim,
                n,
                self.cells,
                b.world_of_cell.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.starts.arg(),
                b.own.arg(),
                b.order.arg(),
            );
            lists::gather::launch_unchecked::<R>(
                client,
                by_particle(),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.order.arg(),
                b.place.arg(),
                b.vel.arg(),
                b.spin.arg(),
                b.own.arg(),
                b.refs.arg(),
                b.slow.arg(),
                b.renamed.arg(),
            );
            self.plant(device);
            self.measure(device);
            self.sum(device, n / SLICE, &b.widths, &b.width_starts);
            if self.signature.surfaces {
                self.approach(device);
            }
            lists::judge::launch_unchecked::<R>(
                client,
                by_world(),
                dim,
                worlds,
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.width_starts.arg(),
                b.row_starts.arg(),
                b.facet_starts.arg(),
                self.signature.surfaces,
            );
            self.keep(device, NONE);
            self.fill(device);
            let pairs = keep::room(self.rooms[0]) / BLOCK;
            keep::restore::launch_unchecked::<R>(
                client,
                grid(pairs as usize),
                dim,
                n,
                self.rooms[0],
                pairs,
                b.world_of_kept.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.lists.arg(),
                b.renamed.arg(),
                b.held.arg(),
                b.kept.arg(),
                b.kept_hist.arg(),
                b.nbr.arg(),
                b.hist.arg(),
                self.signature.quads(),
                self.signature.graded,
            );
            if self.signature.surfaces {
                self.settle(device);
            }
            lists::commit::launch_unchecked::<R>(
                client,
                by_world(),
                dim,
                worlds,
                b.worlds.arg(),
                b.states.arg(),
                b.flags.arg(),
                b.row_starts.arg(),
                b.facet_starts.arg(),
                self.signature.surfaces,
            );
        }
    }

    /// Builds the hierarchies over the particles of worlds that search with them.
    fn plant<R: Runtime>(&self, device: &Device<R>) {
        let b = &self.b;
        let leaves = self.regions.iter().zip(&self.worlds).map(|(r, c)| leaves(c, r.blocks)).max();
        // SAFETY: the kernel stays within the hierarchies of its worlds, for which the buffer was laid out.
        #[allow(unsafe_code)]
        unsafe {
            for level in 0..leaves.map_or(0, |leaves| u32::BITS - leaves.leading_zeros()) {
                search::grow::launch_unchecked::<R>(
                    device.client(),
                    grid((self.padded / search::LEAF).div_ceil(BLOCK) as usize),
                    CubeDim::new_1d(BLOCK),
                    level,
                    self.padded,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.refs.arg(),
                    b.tree.arg(),
                );
            }
        }
    }

    /// Counts neighbours.
    fn measure<R: Runtime>(&self, device: &Device<R>) {
        let (b, n, s) = (&self.b, self.padded, self.signature);
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if s.grids() {
                grades::measure::launch_unchecked::<R>(
                    device.client(),
                    grid((n / SLICE) as usize),
                    dim,
                    n,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.starts.arg(),
                    b.refs.arg(),
                    b.own.arg(),
                    b.listed.arg(),
                    b.widths.arg(),
                    b.nbr.arg(),
                    s.orthogonal,
                );
            } else {
                lists::measure::launch_unchecked::<R>(
                    device.client(),
                    grid((n / BLOCK) as usize),
                    dim,
                    n,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.starts.arg(),
                    b.refs.arg(),
                    b.own.arg(),
                    b.tree.arg(),
                    b.listed.arg(),
                    b.widths.arg(),
                    b.nbr.arg(),
                    s.search,
                    s.orthogonal,
                );
            }
        }
    }

    /// Writes lists.
    fn fill<R: Runtime>(&self, device: &Device<R>) {
        let (b, n, s) = (&self.b, self.padded, self.signature);
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            if s.grids() {
                grades::fill::launch_unchecked::<R>(
                    device.client(),
                    grid((n / SLICE) as usize),
                    dim,
                    n,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.starts.arg(),
                    b.refs.arg(),
                    b.own.arg(),
                    b.listed.arg(),
                    b.width_starts.arg(),
                    b.lists.arg(),
                    b.nbr.arg(),
                    s.orthogonal,
                );
            } else {
                lists::fill::launch_unchecked::<R>(
                    device.client(),
                    grid((n / BLOCK) as usize),
                    dim,
                    n,
                    b.world_of.arg(),
                    b.worlds.arg(),
                    b.states.arg(),
                    b.starts.arg(),
                    b.refs.arg(),
                    b.own.arg(),
                    b.tree.arg(),
                    b.listed.arg(),
                    b.width_starts.arg(),
                    b.lists.arg(),
                    b.nbr.arg(),
                    s.search,
                    s.orthogonal,
                );
            }
        }
    }

    /// Keeps what the pairs of the worlds that are being rebuilt remember, or of the world `only`.
    pub(super) fn keep<R: Runtime>(&self, device: &Device<R>, only: u32) {
        let b = &self.b;
        // SAFETY: the kernel stays within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            keep::keep::launch_unchecked::<R>(
                device.client(),
                grid((self.padded / BLOCK) as usize),
                CubeDim::new_1d(BLOCK),
                self.padded,
                self.rooms[0],
                only,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.lists.arg(),
                b.nbr.arg(),
                b.hist.arg(),
                b.held.arg(),
                b.kept.arg(),
                b.kept_hist.arg(),
                self.signature.quads(),
            );
        }
    }

    /// Counts what particles are near to.
    fn approach<R: Runtime>(&self, device: &Device<R>) {
        let b = &self.b;
        let n = self.padded;
        let dim = CubeDim::new_1d(BLOCK);
        // SAFETY: kernels stay within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            rows::approach::launch_unchecked::<R>(
                device.client(),
                grid((n / BLOCK) as usize),
                dim,
                n,
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.refs.arg(),
                b.bounds.arg(),
                b.poses.arg(),
                b.nodes.arg(),
                b.ordered.arg(),
                b.tris.arg(),
                b.verts.arg(),
                b.facets.arg(),
                b.near_count.arg(),
                b.near_flag.arg(),
                self.signature,
            );
        }
        self.sum(device, n, &b.near_flag, &b.row_starts);
        self.sum(device, n, &b.near_count, &b.facet_starts);
    }

    /// Writes what particles are near to.
    fn settle<R: Runtime>(&self, device: &Device<R>) {
        let (b, n) = (&self.b, self.padded);
        // SAFETY: the kernel stays within the buffers, whose sizes follow from the same layout.
        #[allow(unsafe_code)]
        unsafe {
            rows::settle::launch_unchecked::<R>(
                device.client(),
                grid((n / BLOCK) as usize),
                CubeDim::new_1d(BLOCK),
                n,
                self.rooms[1],
                self.rooms[2],
                b.world_of.arg(),
                b.worlds.arg(),
                b.states.arg(),
                b.refs.arg(),
                b.order.arg(),
                b.bounds.arg(),
                b.poses.arg(),
                b.nodes.arg(),
                b.ordered.arg(),
                b.tris.arg(),
                b.verts.arg(),
                b.row_starts.arg(),
                b.facet_starts.arg(),
                b.rows.arg(),
                b.facets.arg(),
                b.row_count.arg(),
                b.row_mem.arg(),
                self.signature,
            );
        }
    }
}
