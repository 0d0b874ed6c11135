//! All roles as threads of this process, on a bus in memory. The functions and the results are the same.

use std::sync::mpsc::Sender;
use std::sync::Arc;
use std::thread::JoinHandle;

use agent::Machine;
use bus::{Bus, Event, Inbox};
use process::{Failure, Role};
use proto::config::Config;
use store::RunFolder;

use crate::drive::Options;
use crate::roles::{listen, Ended, News, Roles};

/// Roles running as threads.
pub struct InProcess {
    /// Receives the scalars while it exists.
    _monitor: Arc<dyn Bus>,
    world: Inbox,
    others: Vec<Inbox>,
    threads: Vec<JoinHandle<()>>,
    stops: u32,
}

impl InProcess {
    /// Starts one thread for each role.
    ///
    /// # Errors
    /// If a role's folder cannot be made.
    pub fn start(
        folder: &RunFolder,
        config: &Config,
        options: &Options,
        machine: Machine,
        news: &Sender<News>,
    ) -> Result<Self, Failure> {
        let hub = bus::memory();
        let monitor = hub.connect();
        listen(&*monitor, config, news.clone())?;
        let mut roles =
            Self { _monitor: monitor, world: bus::inbox().0, others: vec![], threads: vec![], stops: 0 };
        let mut begin = |name: String, run: Box<Run>| -> Result<Inbox, Failure> {
            let role = Role::new(hub.connect(), config.clone(), folder.role(&name)?, options.wait)?;
            let (stop, news) = (role.inbox.clone(), news.clone());
            roles.threads.push(std::thread::spawn(move || {
                let result = run(role);
                // The receiver is gone only if the run is abandoned.
                let _ = news.send(News::Ended { role: name, result });
            }));
            Ok(stop)
        };
        let start_over = options.start_over;
        let world = begin(
            "world".to_owned(),
            Box::new(move |role| {
                env_server::run(role, start_over).map(|closed| match closed {
                    env_server::Closed::Finished => Ended::Finished,
                    env_server::Closed::Stopped => Ended::Stopped,
                })
            }),
        )?;
        let coordinator = Box::new(|role| coordinator::run(role).map(|_| Ended::Finished));
        let mut others = vec![begin("coordinator".to_owned(), coordinator)?];
        for id in 0..config.world.agents {
            let agent = Box::new(move |role| {
                agent::run(role, id, machine).map(|left| match left {
                    agent::Left::Finished => Ended::Finished,
                    agent::Left::Stopped => Ended::Stopped,
                })
            });
            others.push(begin(format!("agent-{id}"), agent)?);
        }
        (roles.world, roles.others) = (world, others);
        Ok(roles)
    }
}

type Run = dyn FnOnce(Role) -> Result<Ended, Failure> + Send;

impl Roles for InProcess {
    fn stop(&mut self) {
        // The env-server closes the run for the others. It may have ended already.
        let _ = self.world.send(Event::Stop);
        self.stops += 1;
        if self.stops > 1 {
            for inbox in &self.others {
                let _ = inbox.send(Event::Stop);
            }
        }
    }

    fn abandon(&mut self) {
        self.stop();
        self.stop();
        for thread in self.threads.drain(..) {
            // A panic has already ended the process.
            let _ = thread.join();
        }
    }
}
