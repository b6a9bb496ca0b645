//! Variables by their references, as the C interface gets and sets them.

use crate::{outputs::HeadOutputs, slave::Slave, state::State, variables::reference};

impl Slave {
    /// Returns the time at which the next step begins, s.
    pub fn time_s(&self) -> f64 {
        self.time_s[0]
    }

    /// Returns the numbers of a variable of double precision; `None` for a reference that is none of them.
    pub fn float64(&self, reference: u32) -> Option<&[f64]> {
        let inputs = &self.inputs;
        Some(match reference {
            reference::TIME => &self.time_s,
            reference::Q_BODY_FROM_ICRF => &inputs.q,
            reference::RATE => &inputs.rate,
            reference::ACCELERATION => &inputs.acceleration,
            reference::JITTER => &inputs.jitter,
            reference::POSITION => &inputs.position,
            reference::VELOCITY => &inputs.velocity,
            other => {
                let (head, within) = self.head(other)?;
                match within {
                    reference::MID_EXPOSURE => &head.mid_exposure_s,
                    reference::TRUTH => &head.truth,
                    reference::TRACKER_Q => &head.tracker_q,
                    reference::TRACKER_TIME => &head.tracker_time_s,
                    _no_such_float => return None,
                }
            }
        })
    }

    /// Returns where the numbers of an input of double precision go; `None` for any other variable.
    pub fn float64_input(&mut self, reference: u32) -> Option<&mut [f64]> {
        let inputs = &mut self.inputs;
        Some(match reference {
            reference::Q_BODY_FROM_ICRF => &mut inputs.q,
            reference::RATE => &mut inputs.rate,
            reference::ACCELERATION => &mut inputs.acceleration,
            reference::JITTER => &mut inputs.jitter,
            reference::POSITION => &mut inputs.position,
            reference::VELOCITY => &mut inputs.velocity,
            _no_input => return None,
        })
    }

    /// Returns a whole number of any size; `None` for a reference that is none.
    pub fn whole(&self, reference: u32) -> Option<i128> {
        Some(match reference {
            reference::TRIGGER => self.inputs.trigger.into(),
            reference::TRIGGER_COUNT => self.inputs.trigger_count.into(),
            reference::REFUSED => self.refused.into(),
            other => {
                let (head, within) = self.head(other)?;
                match within {
                    reference::FRAMES => head.frames.into(),
                    reference::STARS => head.stars.into(),
                    reference::TRACKER_STARS => head.tracker_stars.into(),
                    _no_such_number => return None,
                }
            }
        })
    }

    /// Sets the number or the count of the trigger; false for any other variable.
    pub fn set_whole(&mut self, reference: u32, value: u32) -> bool {
        match (reference, u16::try_from(value)) {
            (reference::TRIGGER, Ok(number)) => self.inputs.trigger = number,
            (reference::TRIGGER_COUNT, _) => self.inputs.trigger_count = value,
            _no_input => return false,
        }
        true
    }

    /// Returns the value of a Boolean variable; `None` for a reference of another type.
    pub fn boolean(&self, reference: u32) -> Option<bool> {
        match reference {
            reference::HAS_OBSERVER => Some(self.inputs.has_observer),
            other => self
                .head(other)
                .filter(|(_, within)| *within == reference::TRACKER_VALID)
                .map(|(head, _)| head.tracker_valid),
        }
    }

    /// Sets whether something is true; false for any other variable.
    pub fn set_boolean(&mut self, reference: u32, value: bool) -> bool {
        match reference {
            reference::HAS_OBSERVER => self.inputs.has_observer = value,
            _no_input => return false,
        }
        true
    }

    /// Returns a text; `None` for a reference that is none.
    pub fn text(&self, reference: u32) -> Option<&str> {
        (reference == reference::OUTPUT_DIR).then_some(self.inputs.output_dir.as_str())
    }

    /// Sets a text; false for any other variable, or after the start.
    pub fn set_text(&mut self, reference: u32, value: &str) -> bool {
        let may_be_set = reference == reference::OUTPUT_DIR && self.is_before_start();
        if may_be_set {
            value.clone_into(&mut self.inputs.output_dir);
        }
        may_be_set
    }

    fn is_before_start(&self) -> bool {
        matches!(self.state, State::Instantiated | State::Initialising)
    }

    /// Returns the head that a reference is of, and the reference within it.
    fn head(&self, reference: u32) -> Option<(&HeadOutputs, u32)> {
        let from_heads = reference.checked_sub(reference::HEADS)?;
        let number = usize::try_from(from_heads / reference::HEAD_STRIDE).ok()?;
        Some((self.heads.get(number)?, from_heads % reference::HEAD_STRIDE))
    }
}
