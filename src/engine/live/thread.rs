//! The scene thread: takes the newest order, selects, manages, publishes.

use super::list::{DisplayList, Order};
use super::remote::Remote;
use super::{Notify, Shared};
use crate::engine::scene::Scene;
use crate::engine::{FrameTimings, Source};
use crate::paging::{KnownWay, PageState};
use crate::select::{Demand, Urgency};
use crossbeam_channel::{Receiver, RecvTimeoutError, Sender};
use std::sync::Arc;
use std::sync::atomic::Ordering;
use std::time::{Duration, Instant};

/// How often arrivals are looked for while pages are under way.
const LOOK_EVERY: Duration = Duration::from_millis(4);
/// So long after the last news there is one more step: policies plan less often than steps come, and what they have not
/// asked for yet would wait for an eye that moves.
const PLAN_AGAIN: Duration = Duration::from_millis(100);
/// How often a scene at rest looks whether a failed page may be tried again.
const REST: Duration = Duration::from_millis(250);

pub(super) struct SceneThread {
    pub scene: Scene,
    pub remote: Remote,
    pub shared: Arc<Shared>,
    /// Something is there to do; its end is the end of this thread.
    pub wake: Receiver<()>,
    pub messages: Sender<String>,
    pub notify: Notify,
    pub order: Order,
    /// When the step after the last news is due.
    pub again: Option<Instant>,
}

impl SceneThread {
    pub fn run(mut self) {
        loop {
            let wait = self.wait();
            match self.wake.recv_timeout(wait) {
                Err(RecvTimeoutError::Disconnected) => return,
                Ok(()) | Err(RecvTimeoutError::Timeout) => {}
            }
            let news = self.take_order() | self.receive() | self.remote.confirm();
            let again = self.again.is_some_and(|again| again <= Instant::now());
            if news || again {
                self.again = news.then(|| Instant::now() + PLAN_AGAIN);
            }
            if news || again || self.scene.wants_step(self.now_s()) {
                self.step(again && !news);
            }
            drop(self.shared.spent.take());
        }
    }

    /// How long nothing has to be looked for.
    fn wait(&self) -> Duration {
        let wait = if self.scene.is_busy() { LOOK_EVERY } else { REST };
        self.again.map_or(wait, |again| wait.min(again.saturating_duration_since(Instant::now())))
    }

    /// Time on the flight's clock: it goes on between orders, for pages that are to be tried again.
    fn now_s(&self) -> f64 {
        self.order.t_s + self.order.at.elapsed().as_secs_f64()
    }

    fn take_order(&mut self) -> bool {
        let Some(order) = self.shared.orders.take() else { return false };
        if !Arc::ptr_eq(&order.source, &self.order.source)
            && let Err(error) = self.scene.set_source(Source::clone(&order.source))
        {
            self.tell(error.to_string());
        }
        if order.params != self.order.params
            && let Err(error) = self.scene.set_params(order.params)
        {
            self.tell(error.to_string());
        }
        self.order = *order;
        self.scene.set_time(self.order.time);
        self.scene
            .set_way(self.order.way.clone().map(|flight| -> KnownWay { Arc::new(move |t_s| flight.pose_at(t_s)) }));
        true
    }

    fn receive(&mut self) -> bool {
        let now_s = self.now_s();
        self.scene.residency.receive(now_s, &mut self.remote) > 0
    }

    /// At rest, where there is time for it, the list tells over-modelling too.
    fn step(&mut self, is_at_rest: bool) {
        let mut list = self.make_list();
        if is_at_rest && list.selection.stats.pages_missing == 0 && !self.scene.is_busy() {
            list.report.take_modelled(&self.scene.modelled(&list.view, &list.selection));
        }
        drop(self.shared.lists.publish(Box::new(list)));
        (self.notify)();
    }

    /// The list of the newest order; what it asks for is under way then. The first one comes before the thread runs.
    pub fn make_list(&mut self) -> DisplayList {
        let (view, now_s) = (self.order.view, self.now_s());
        let mut timings = FrameTimings::default();
        let chosen = self.scene.advance(&view, now_s, &mut self.remote, &mut timings);
        let mut report = self.scene.report(&chosen, self.order.t_s, &self.remote);
        report.timings = timings;
        self.shared.footprint_max_bytes.fetch_max(report.footprint_bytes, Ordering::Relaxed);
        for message in self.scene.residency.take_messages() {
            self.tell(message);
        }
        let (number, changes) = self.remote.publish();
        let totals = self.scene.totals();
        let manager = &self.scene.residency.manager;
        let wanted = chosen.selection.demands.iter().map(|demand| (demand, manager.state(demand.page)));
        // Ground on the way to finer ground that is not asked for lacks nowhere.
        let is_passed = |demand: &Demand, state| demand.urgency == Urgency::Blocking && state == PageState::Absent;
        let lacks = |(demand, state): &(&Demand, _)| *state != PageState::Resident && !is_passed(demand, *state);
        let lacking = wanted.filter(lacks).map(|(demand, state)| (demand.page, state)).collect();
        let since = |since_s: f64| Instant::now().checked_sub(Duration::try_from_secs_f64(now_s - since_s).ok()?);
        let awaited_since = manager.awaited_since_secs().and_then(since);
        let (pages, selection) = (manager.page_counts(), chosen.selection);
        let limits = self.scene.residency.gpu_limits();
        DisplayList { number, view, selection, pages, awaited_since, lacking, limits, report, totals, changes }
    }

    /// What does not fit into the queue is one of many of its kind.
    fn tell(&self, message: String) {
        let _ = self.messages.try_send(message);
    }
}
