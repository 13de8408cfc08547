//! Connections that read.

use std::sync::Arc;

use parking_lot::Mutex;
use tesserae_mesh::error::Result;
use tokio::runtime::{Handle, RuntimeFlavor};
use tokio::sync::Semaphore;
use tokio::task::block_in_place;

use super::super::rows::{Abort, Rows};
use super::check::Damage;
use super::place::{DatabasePlace, closed, failure};
use super::session::Session;

const READERS: u32 = 4;

#[derive(Debug)]
pub struct Readers {
    place: Arc<DatabasePlace>,
    /// One for each connection that may be.
    places: Semaphore,
    pub damage: Arc<Damage>,
    idle: Mutex<Vec<Session>>,
}

impl Readers {
    pub fn open(place: Arc<DatabasePlace>) -> rusqlite::Result<Self> {
        let places = Semaphore::new(READERS as usize);
        let readers = Self { place, places, damage: Arc::default(), idle: Mutex::default() };
        readers.give_back(Session::new(readers.place.reading()?));
        Ok(readers)
    }

    /// Reads rows on this thread. Where that takes long, the other tasks of this thread continue on another one.
    pub async fn read<T>(&self, work: impl FnOnce(&mut dyn Rows) -> Result<T, Abort>) -> Result<T> {
        let _place = self.places.acquire().await.map_err(|_| closed())?;
        match Handle::current().runtime_flavor() {
            RuntimeFlavor::CurrentThread => self.work(work),
            _ => block_in_place(|| self.work(work)),
        }
    }

    /// Waits for reads under way, and closes the connections.
    pub async fn close(&self) {
        let _all = self.places.acquire_many(READERS).await;
        self.idle.lock().clear();
        self.places.close();
    }

    fn work<T>(&self, work: impl FnOnce(&mut dyn Rows) -> Result<T, Abort>) -> Result<T> {
        let idle = self.idle.lock().pop();
        let mut session = match idle {
            Some(session) => session,
            None => Session::new(self.place.reading().map_err(failure)?),
        };
        let outcome = work(&mut session);
        match outcome {
            Ok(_) | Err(Abort::Refused(_)) => {
                self.give_back(session);
                outcome.map_err(Abort::into_error)
            }
            // a connection that failed is not used again
            Err(abort) => Err(self.damage.note(abort.into_error())),
        }
    }

    fn give_back(&self, session: Session) {
        self.idle.lock().push(session);
    }
}
