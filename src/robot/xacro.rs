//! Making a URDF of a xacro file with the program `xacro`, where that is installed.

use super::files::one_line;
use std::io::Read;
use std::path::Path;
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

const MAX_OUTPUT: u64 = 1 << 27;
const MAX_TIME: Duration = Duration::from_secs(60);

/// The URDF that xacro makes of `path`; the error says why there is none.
pub fn run(path: &Path) -> Result<String, String> {
    let advice = format!(
        "make a URDF of it with `xacro {} > robot.urdf` (`pip install xacro`)",
        path.display()
    );
    // An absolute path, which no option looks like.
    let absolute = std::path::absolute(path).map_err(|e| one_line(&e))?;
    let mut child = Command::new("xacro")
        .arg(absolute)
        .stdin(Stdio::null())
        .stdout(Stdio::piped())
        .stderr(Stdio::piped())
        .spawn()
        .map_err(|_| format!("it is written in xacro, and that is not installed; {advice}"))?;
    let collect = |pipe: Option<Box<dyn Read + Send>>, most: u64| {
        std::thread::spawn(move || {
            let mut bytes = Vec::new();
            if let Some(pipe) = pipe {
                // What cannot be read is missed below.
                let _ = pipe.take(most + 1).read_to_end(&mut bytes);
            }
            bytes
        })
    };
    let output = child.stdout.take().map(|pipe| Box::new(pipe) as Box<_>);
    let output = collect(output, MAX_OUTPUT);
    let errors = child.stderr.take().map(|pipe| Box::new(pipe) as Box<_>);
    let errors = collect(errors, 1 << 16);
    let start = Instant::now();
    let status = loop {
        match child.try_wait() {
            Ok(Some(status)) => break Some(status),
            Ok(None) if start.elapsed() < MAX_TIME => std::thread::sleep(Duration::from_millis(5)),
            _ => {
                let _ = child.kill();
                let _ = child.wait();
                break None;
            }
        }
    };
    let Some(status) = status else {
        let seconds = MAX_TIME.as_secs();
        return Err(format!("xacro did not end within {seconds} s; {advice}"));
    };
    let output = output.join().unwrap_or_default();
    let errors = errors.join().unwrap_or_default();
    if !status.success() {
        // The last lines say what was wrong; what comes before are warnings.
        let said = one_line(&String::from_utf8_lossy(&errors));
        let skipped = said.chars().count().saturating_sub(300);
        let said: String = said.chars().skip(skipped).collect();
        return Err(format!("xacro failed: {said}"));
    }
    if output.len() as u64 > MAX_OUTPUT {
        return Err(format!("xacro wrote more than {} MiB", MAX_OUTPUT >> 20));
    }
    String::from_utf8(output).map_err(|_| "xacro wrote text that is not UTF-8".to_owned())
}
