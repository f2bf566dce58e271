//! The complete state as bytes and back, bit for bit.
//!
//! Little-endian: the progress as JSON behind its length, the number of particles and their columns one
//! after the other, then contact memories. Files wrap this with a version and a checksum.

use crate::lattice::determinant;
use crate::setup::Constants;
use crate::state::{ContactMemory, Particles, Place, Progress, Spin, State, SurfaceMemory, Velocity};

/// Why bytes are not a state.
#[derive(Clone, Debug, PartialEq, Eq, thiserror::Error)]
#[non_exhaustive]
pub enum BytesError {
    /// Too short.
    #[error(
        "the state ends after {have} bytes where {need} more are needed; the file is cut short or of another version"
    )]
    Short {
        /// Bytes there.
        have: usize,
        /// Bytes missing.
        need: usize,
    },
    /// Bytes left over.
    #[error("{0} bytes follow the state; the file is of another version")]
    Long(usize),
    /// Not a state of the world that it is to be.
    #[error("the state is not one of this world: {0}; the file is of another version, or was changed")]
    OtherWorld(String),
    /// The progress cannot be read.
    #[error("the progress cannot be read: {0}")]
    Progress(String),
}

impl State {
    /// The state as bytes. A pure read.
    pub fn to_bytes(&self) -> Vec<u8> {
        let mut w = Writer(Vec::with_capacity(160 * self.particles.len() + 4096));
        // Plain data with finite numbers: serialising it cannot fail.
        let progress = serde_json::to_vec(&self.progress).unwrap_or_default();
        w.u64(progress.len() as u64);
        w.0.extend_from_slice(&progress);
        let p = &self.particles;
        w.u64(p.len() as u64);
        p.id.iter().for_each(|x| w.u32(*x));
        for x in &p.place {
            x.lo.iter().for_each(|u| w.u32(*u));
            w.f32(x.radius);
        }
        for x in &p.velocity {
            w.f32s(&x.v);
            w.f32(x.inv_mass);
        }
        for x in &p.spin {
            w.f32s(&x.w);
            w.u32(x.material);
        }
        p.hi.iter().chain(&p.hi_ref).flatten().for_each(|x| w.u32(*x as u32));
        p.lo_ref.iter().flatten().for_each(|x| w.u32(*x));
        for column in [&p.rest, &p.acceleration, &p.angular, &p.force] {
            for x in column {
                w.f32s(x);
            }
        }
        let history = self.contacts.first().map_or(0, |m| m.history.len());
        let history = self.surface_contacts.first().map_or(history, |m| m.history.len());
        w.u64(history as u64);
        w.u64(self.contacts.len() as u64);
        for m in &self.contacts {
            w.u32(m.id[0]);
            w.u32(m.id[1]);
            w.f32s(&m.history);
        }
        w.u64(self.surface_contacts.len() as u64);
        for m in &self.surface_contacts {
            w.u32(m.id);
            w.u32(m.surface);
            w.f32s(&m.n);
            w.f32s(&m.history);
        }
        w.0
    }

    /// The state that [`State::to_bytes`] made.
    pub fn from_bytes(bytes: &[u8]) -> Result<Self, BytesError> {
        let mut r = Reader { bytes, at: 0 };
        let length = r.count(1)?;
        let progress: Progress =
            serde_json::from_slice(r.take(length)?).map_err(|e| BytesError::Progress(e.to_string()))?;
        let n = r.count(4)?;
        let mut p = Particles { id: r.many(n, Reader::u32)?, ..Particles::default() };
        p.place = r.many(n, |r| Ok(Place { lo: r.u32x3()?, radius: r.f32()? }))?;
        p.velocity = r.many(n, |r| Ok(Velocity { v: r.f32x3()?, inv_mass: r.f32()? }))?;
        p.spin = r.many(n, |r| Ok(Spin { w: r.f32x3()?, material: r.u32()? }))?;
        p.hi = r.many(n, |r| Ok(r.u32x3()?.map(|x| x as i32)))?;
        p.hi_ref = r.many(n, |r| Ok(r.u32x3()?.map(|x| x as i32)))?;
        p.lo_ref = r.many(n, Reader::u32x3)?;
        p.rest = r.many(n, Reader::f32x3)?;
        p.acceleration = r.many(n, Reader::f32x3)?;
        p.angular = r.many(n, Reader::f32x3)?;
        p.force = r.many(n, Reader::f32x3)?;
        let history = r.count(0)?;
        let n = r.count(8)?;
        let contacts = r.many(n, |r| {
            Ok(ContactMemory { id: [r.u32()?, r.u32()?], history: r.many(history, Reader::f32)? })
        })?;
        let n = r.count(8)?;
        let surface_contacts = r.many(n, |r| {
            Ok(SurfaceMemory {
                id: r.u32()?,
                surface: r.u32()?,
                n: r.f32x3()?,
                history: r.many(history, Reader::f32)?,
            })
        })?;
        match bytes.len() - r.at {
            0 => Ok(Self { particles: p, contacts, surface_contacts, progress }),
            more => Err(BytesError::Long(more)),
        }
    }

    /// Whether the world may have this state: nothing in it points beyond what there is.
    ///
    /// # Errors
    /// [`BytesError::OtherWorld`].
    pub fn belongs_to(&self, c: &Constants) -> Result<(), BytesError> {
        self.check(c).map_err(BytesError::OtherWorld)
    }

    fn check(&self, c: &Constants) -> Result<(), String> {
        let need = |fits: bool, what: &str| if fits { Ok(()) } else { Err(what.to_owned()) };
        let (p, g) = (&self.particles, &self.progress);
        let mut there = p.id.clone();
        there.sort_unstable();
        let twice = there.windows(2).find(|pair| pair[0] == pair[1]).map(|pair| pair[0]);
        let foreign = there.last().copied().filter(|id| u64::from(*id) >= c.numbers(g));
        if let Some(id) = twice.or(foreign) {
            return Err(format!("particle {id} is not of it, or there twice"));
        }
        // Radii are rounded to f32.
        let most = c.radius_max as f32 * (1.0 + f32::EPSILON);
        need(p.place.iter().all(|x| x.radius > 0.0 && x.radius <= most), "a radius")?;
        need(p.velocity.iter().all(|x| x.inv_mass > 0.0 && x.inv_mass.is_finite()), "a mass")?;
        need(p.velocity.iter().all(|x| x.v.iter().all(|v| v.is_finite())), "a velocity")?;
        need(p.spin.iter().all(|x| (x.material as usize) < c.spec.materials.len()), "a material")?;
        let has = |id: u32| there.binary_search(&id).is_ok();
        let remembered = |history: &[f32]| history.len() == c.history.len();
        let pairs =
            |m: &ContactMemory| m.id[0] < m.id[1] && m.id.iter().all(|id| has(*id)) && remembered(&m.history);
        need(self.contacts.iter().all(pairs), "a contact")?;
        let sides = |m: &SurfaceMemory| {
            has(m.id) && (m.surface as usize) < c.boundaries.len() && remembered(&m.history)
        };
        need(self.surface_contacts.iter().all(sides), "a contact with a surface")?;

        let surfaces = c.spec.surfaces.len();
        need(g.stage <= c.spec.stages.len() && g.results.len() == g.stage, "its stage")?;
        let measures = c.spec.stages.get(g.stage).map_or(g.measures.len(), |s| s.measures.len());
        need(g.measures.len() == measures, "its measures")?;
        need([g.surfaces.len(), g.path.len(), g.impulse.len()] == [surfaces; 3], "its surfaces")?;
        let doors = [c.spec.inlets.len(), c.spec.outlets.len()];
        need([g.inlets.len(), g.outlets.len()] == doors, "its inlets and outlets")?;
        let listed = if c.lists_wear() { surfaces } else { 0 };
        let facets = |(s, worn): (usize, &Vec<f64>)| worn.len() == c.unworn(s).len();
        need(g.wear.len() == listed && g.wear.iter().enumerate().all(facets), "its wear")?;
        let since = g.surfaces.iter().map(|s| s.since).chain([g.stage_since, g.rebuilt]);
        let since = since.chain(g.inlets.iter().map(|inlet| inlet.since)).max();
        need(since <= Some(g.step), "its steps")?;
        let volume = g.cell.map_or(1.0, |cell| determinant(&cell.matrix));
        let cell = g.cell.is_some() == c.deforms() && volume > 0.0 && volume.is_finite();
        need(cell, "its cell")?;
        need(g.skin >= 0.0 && g.skin.is_finite(), "its lists")
    }
}

struct Writer(Vec<u8>);

impl Writer {
    fn u64(&mut self, x: u64) {
        self.0.extend_from_slice(&x.to_le_bytes());
    }
    fn u32(&mut self, x: u32) {
        self.0.extend_from_slice(&x.to_le_bytes());
    }
    fn f32(&mut self, x: f32) {
        self.u32(x.to_bits());
    }
    fn f32s(&mut self, xs: &[f32]) {
        for x in xs {
            self.f32(*x);
        }
    }
}

struct Reader<'a> {
    bytes: &'a [u8],
    at: usize,
}

impl<'a> Reader<'a> {
    fn take(&mut self, n: usize) -> Result<&'a [u8], BytesError> {
        let left = self.bytes.len() - self.at;
        if n > left {
            return Err(BytesError::Short { have: self.bytes.len(), need: n - left });
        }
        self.at += n;
        Ok(&self.bytes[self.at - n..self.at])
    }
    fn u64(&mut self) -> Result<u64, BytesError> {
        Ok(self.take(8)?.iter().rev().fold(0, |x, b| x << 8 | u64::from(*b)))
    }
    fn u32(&mut self) -> Result<u32, BytesError> {
        Ok(self.take(4)?.iter().rev().fold(0, |x, b| x << 8 | u32::from(*b)))
    }
    fn f32(&mut self) -> Result<f32, BytesError> {
        self.u32().map(f32::from_bits)
    }
    fn u32x3(&mut self) -> Result<[u32; 3], BytesError> {
        Ok([self.u32()?, self.u32()?, self.u32()?])
    }
    fn f32x3(&mut self) -> Result<[f32; 3], BytesError> {
        Ok([self.f32()?, self.f32()?, self.f32()?])
    }
    /// A count of things of at least `size` bytes each: never more than the bytes that are left.
    fn count(&mut self, size: usize) -> Result<usize, BytesError> {
        let n = self.u64()?;
        let left = (self.bytes.len() - self.at) as u64;
        if n.saturating_mul(size as u64) > left {
            let need = n.saturating_mul(size as u64) - left;
            return Err(BytesError::Short { have: self.bytes.len(), need: need as usize });
        }
        Ok(n as usize)
    }
    fn many<T, C: FromIterator<T>>(
        &mut self,
        n: usize,
        mut one: impl FnMut(&mut Self) -> Result<T, BytesError>,
    ) -> Result<C, BytesError> {
        (0..n).map(|_| one(self)).collect()
    }
}
