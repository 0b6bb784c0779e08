//! The program on a copy of this repository's text: what a mistake in each kind of file looks like,
//! and that runs leave the same bits behind however they went.

use std::fs;
use std::os::unix::process::ExitStatusExt;
use std::path::{Path, PathBuf};
use std::process::{Command, Stdio};
use std::time::{Duration, Instant};

/// Studies, sets, cameras and robots, with a smoke profile of a few images in three folds.
struct Repository(tempfile::TempDir);

impl Repository {
    fn new() -> Repository {
        let repository = Repository(tempfile::tempdir().unwrap());
        let here = Path::new(env!("CARGO_MANIFEST_DIR"));
        for name in [
            "Cargo.toml",
            "experiments",
            "data/sets",
            "data/cameras",
            "data/robots",
        ] {
            copy(&here.join(name), &repository.path(name));
        }
        let fig9 = fs::read_to_string(repository.path("experiments/fig9.toml")).unwrap();
        let objectives = fig9.lines().find(|l| l.starts_with("objectives = "));
        let one = "objectives = [\"mspd\"]";
        repository.edit("experiments/fig9.toml", objectives.unwrap(), one);
        let (both, whole) = (
            "segmentation = [\"none\", \"forest\"]",
            "segmentation = [\"none\"]",
        );
        repository.edit("experiments/fig9.toml", both, whole);
        repository.edit(
            "experiments/fig9.toml",
            "[smoke]\nprotocol.images = 20",
            "[smoke]\nprotocol.images = 9\nprotocol.folds = 3",
        );
        repository
    }

    fn path(&self, relative: &str) -> PathBuf {
        self.0.path().join(relative)
    }

    /// Replaces the first `old` in a file, which must be there.
    fn edit(&self, file: &str, old: &str, new: &str) {
        let text = fs::read_to_string(self.path(file)).unwrap();
        assert!(text.contains(old), "{file} has no {old:?}");
        fs::write(self.path(file), text.replacen(old, new, 1)).unwrap();
    }

    fn command(&self, arguments: &[&str]) -> Command {
        let mut command = Command::new(env!("CARGO_BIN_EXE_armpose"));
        command.args(arguments).current_dir(self.0.path());
        command
    }

    /// `experiment fig7 --profile smoke` and `more`, which must succeed; what it said on stderr.
    fn run(&self, more: &[&str]) -> String {
        let arguments = [&FIG7[..], more].concat();
        let output = self.command(&arguments).output().unwrap();
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(0), "{stderr}");
        stderr
    }

    /// What must not differ between runs.
    fn results(&self) -> Vec<Vec<u8>> {
        let folder = self.path("results/smoke");
        assert_eq!(names(&folder), ["fig7"], "something half-written is left");
        ["data.csv", "summary.csv", "claims.json", "fig7.svg"]
            .map(|name| fs::read(folder.join("fig7").join(name)).unwrap())
            .to_vec()
    }

    /// Exit code 2, nothing on stdout, no results, and one message; returns it without the name of the
    /// temporary folder.
    fn mistake(&self, arguments: &[&str]) -> String {
        let output = self.command(arguments).output().unwrap();
        let stderr = text(&output.stderr);
        assert_eq!(output.status.code(), Some(2), "{stderr}");
        assert_eq!(text(&output.stdout), "");
        assert!(!stderr.contains("panicked"), "{stderr}");
        let results = self.path("results/smoke");
        assert!(!results.is_dir() || names(&results).is_empty());
        let message = stderr.strip_prefix("armpose: ").unwrap_or(&stderr);
        message.replace(&format!("{}/", self.0.path().display()), "")
    }

    /// The folders of finished results of a stage in the cache.
    fn cached(&self, stage: &str) -> Vec<PathBuf> {
        let stage = self.path("data/cache").join(stage);
        let is_finished = |name: &String| !name.starts_with('.');
        let finished = names(&stage).into_iter().filter(is_finished);
        finished.map(|name| stage.join(name)).collect()
    }
}

const FIG7: [&str; 4] = ["experiment", "fig7", "--profile", "smoke"];

fn text(bytes: &[u8]) -> String {
    String::from_utf8_lossy(bytes).into_owned()
}

/// Of what is in a folder, in alphabetical order; nothing when there is no folder.
fn names(folder: &Path) -> Vec<String> {
    let entries = folder.read_dir().into_iter().flatten().flatten();
    let mut names: Vec<String> = entries
        .map(|entry| entry.file_name().to_string_lossy().into_owned())
        .collect();
    names.sort();
    names
}

fn copy(from: &Path, to: &Path) {
    if from.is_dir() {
        fs::create_dir_all(to).unwrap();
        for name in names(from) {
            copy(&from.join(&name), &to.join(&name));
        }
    } else {
        fs::copy(from, to).unwrap();
    }
}

#[test]
fn a_misspelt_key_is_shown_where_it_is() {
    let repository = Repository::new();
    let file = "experiments/fig9.toml";
    repository.edit(file, "objectives = ", "objectvies = ");
    let lines = fs::read_to_string(repository.path(file)).unwrap();
    let number = 1 + lines
        .lines()
        .position(|l| l.starts_with("objectvies"))
        .unwrap();
    let margin = " ".repeat(number.to_string().len());
    assert_eq!(
        repository.mistake(&["experiment", "show", "fig9"]),
        format!(
            "{file}:{number}:1: unknown field `objectvies`, expected one of `objectives`, \
             `segmentation`, `segmentation_study`, `t_r`, `shown`, `protocol`; did you mean `objectives`?\n\
             {margin} |\n{number} | objectvies = [\"mspd\"]\n{margin} | ^^^^^^^^^^\n"
        )
    );

    let repository = Repository::new();
    repository.edit("data/sets/pef.toml", "\ntarget = ", "\ntraget = ");
    let message = repository.mistake(&FIG7);
    assert!(message.contains("data/sets/pef.toml:"), "{message}");
    assert!(message.contains("did you mean `target`?\n"), "{message}");
    assert!(message.ends_with(" | ^^^^^^\n"), "{message}");

    let repository = Repository::new();
    repository.edit("data/cameras/realistic.toml", "\nfx = ", "\nfxx = ");
    let message = repository.mistake(&FIG7);
    assert!(message.contains("cameras/realistic.toml:"), "{message}");
    assert!(message.contains("unknown field `fxx`"), "{message}");
    assert!(message.ends_with(" | ^^^\n"), "{message}");
}

#[test]
fn a_setting_that_does_not_exist_or_makes_no_sense_is_refused() {
    let repository = Repository::new();
    for (setting, message) in [
        (
            "protocol.imagse=3",
            "--set:1:10: no parameter `imagse` to override; did you mean `images`?",
        ),
        (
            "protocol.images=many",
            "--set:1:17: `images` is of type integer, not string",
        ),
        (
            "protocol.images",
            "--set protocol.images: expected key=value",
        ),
        (
            "protocol.folds=1",
            "experiments/fig9.toml: folds = 1, images = 9: choose 2 folds up to one for each image",
        ),
    ] {
        let found =
            repository.mistake(&["experiment", "fig9", "--profile", "smoke", "--set", setting]);
        assert!(found.starts_with(message), "{found}");
    }
}

#[test]
fn a_plan_runs_nothing_and_writes_nothing() {
    let repository = Repository::new();
    let plan = [&FIG7[..], &["--plan"]].concat();
    let output = repository.command(&plan).output().unwrap();
    assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
    let plan = text(&output.stdout);
    let total = plan.lines().last().unwrap();
    // The set, the distances, and for each fold a forest and its estimates.
    assert!(total.starts_with("8 to run, 0 cached; about "), "{plan}");
    assert_eq!(
        names(repository.0.path()),
        ["Cargo.toml", "data", "experiments"]
    );
    assert_eq!(
        names(&repository.path("data")),
        ["cameras", "robots", "sets"]
    );
}

#[test]
fn a_robot_that_cannot_be_used_is_told_what_is_wrong() {
    let urdf = "data/robots/arm/arm.urdf";
    let mesh = "data/robots/arm/meshes/wam3.stl";

    let repository = Repository::new();
    fs::remove_file(repository.path(mesh)).unwrap();
    let message = repository.mistake(&FIG7);
    assert!(message.contains("robots/arm/arm.urdf: link"), "{message}");
    assert!(
        message.contains("cannot use mesh \"meshes/wam3.stl\": there is no file "),
        "{message}"
    );

    // The base of the right arm hangs on the arm's own shoulder.
    let repository = Repository::new();
    let text = fs::read_to_string(repository.path(urdf)).unwrap();
    let joint = text.find("<joint name=\"R_BASE_FIXED\"").unwrap();
    let parent = joint + text[joint..].find("<parent link=\"").unwrap();
    let end = parent + text[parent..].find("/>").unwrap();
    let looped = format!(
        "{}<parent link=\"R_SHOULDER\"{}",
        &text[..parent],
        &text[end..]
    );
    fs::write(repository.path(urdf), looped).unwrap();
    let message = repository.mistake(&FIG7);
    assert!(
        message.contains("robots/arm/arm.urdf: the links form a loop through \"R_"),
        "{message}"
    );

    // A mesh exported in millimetres.
    let repository = Repository::new();
    let mut stl = fs::read(repository.path(mesh)).unwrap();
    for triangle in stl[84..].chunks_exact_mut(50) {
        for number in triangle[12..48].chunks_exact_mut(4) {
            let metres = f32::from_le_bytes(number.try_into().unwrap());
            number.copy_from_slice(&(1000.0 * metres).to_le_bytes());
        }
    }
    fs::write(repository.path(mesh), stl).unwrap();
    let message = repository.mistake(&FIG7);
    assert!(message.contains("is in millimetres"), "{message}");
    assert!(message.contains("scale=\"0.001 0.001 0.001\""), "{message}");
}

#[test]
fn a_folder_that_cannot_be_written_is_found_before_any_work() {
    let repository = Repository::new();
    fs::write(repository.path("results"), "a file").unwrap();
    let message = repository.mistake(&FIG7);
    let start = "cannot write into the results folder results/smoke: ";
    assert!(message.starts_with(start), "{message}");
    let elsewhere = [&FIG7[..], &["--out", "Cargo.toml"]].concat();
    let message = repository.mistake(&elsewhere);
    let start = "cannot write into the results folder Cargo.toml: ";
    assert!(message.starts_with(start), "{message}");
    assert!(!repository.path("data/cache").exists());

    let repository = Repository::new();
    fs::write(repository.path("data/cache"), "a file").unwrap();
    let message = repository.mistake(&FIG7);
    assert!(
        message.starts_with("cannot write data/cache: "),
        "{message}"
    );
}

#[test]
fn threads_a_kill_and_damaged_images_leave_the_same_bits() {
    let undisturbed = Repository::new();
    undisturbed.run(&["--threads", "1"]);
    let results = undisturbed.results();

    let killed = Repository::new();
    let mut child = killed
        .command(&[&FIG7[..], &["--threads", "2"]].concat())
        .stdout(Stdio::null())
        .stderr(Stdio::null())
        .spawn()
        .unwrap();
    let deadline = Instant::now() + Duration::from_secs(60);
    while killed.cached("pose-forest").is_empty() && Instant::now() < deadline {
        std::thread::sleep(Duration::from_millis(1));
    }
    child.kill().unwrap();
    assert_eq!(child.wait().unwrap().signal(), Some(9), "it was too quick");
    assert!(!killed.cached("pose-forest").is_empty());
    assert!(names(&killed.path("results/smoke")).is_empty());
    killed.run(&["--threads", "2"]);
    assert_eq!(killed.results(), results);
    assert_eq!(killed.cached("pose-forest").len(), 3);

    // Other tools like to convert depth to 8 bits.
    let image = killed.cached("data-set")[0].join("depth/000004.png");
    let whole = fs::read(&image).unwrap();
    let mut encoder = png::Encoder::new(fs::File::create(&image).unwrap(), 640, 480);
    encoder.set_color(png::ColorType::Grayscale);
    encoder.set_depth(png::BitDepth::Eight);
    let mut writer = encoder.write_header().unwrap();
    writer.write_image_data(&vec![200; 640 * 480]).unwrap();
    writer.finish().unwrap();
    let warning = format!("warning: {} has ", image.display());
    let stderr = killed.run(&[]);
    assert!(stderr.starts_with(&warning), "{stderr}");
    assert_eq!(fs::read(&image).unwrap(), whole);
    assert_eq!(killed.results(), results);

    fs::write(&image, &whole[..whole.len() / 2]).unwrap();
    let stderr = killed.run(&[]);
    assert!(stderr.starts_with(&warning), "{stderr}");
    assert_eq!(fs::read(&image).unwrap(), whole);
    assert_eq!(killed.results(), results);

    // Nothing is left to do, neither for this study nor for the one that shares its work.
    assert_eq!(killed.run(&[]), "");
    assert_eq!(killed.run(&["fig9"]), "");
}

#[test]
fn a_study_without_its_data_is_skipped() {
    let repository = Repository::new();
    let nowhere = repository.path("nowhere");
    let output = repository
        .command(&["experiment", "fig12", "--profile", "smoke"])
        .env("ARMPOSE_SHARED", &nowhere)
        .output()
        .unwrap();
    let said = String::from_utf8(output.stderr).unwrap();
    assert!(output.status.success(), "{said}");
    assert!(said.contains("fig12: skipped: there is no "), "{said}");
    assert!(!repository.path("results/smoke/fig12").exists());
}

/// What was run twice is the same, and what was run with other parameters is told apart; the cache holds
/// what was made, until nobody asks for it.
#[test]
fn runs_are_compared_and_the_cache_is_kept() {
    let repository = Repository::new();
    let run = |arguments: &[&str]| {
        let output = repository.command(arguments).output().unwrap();
        let said = String::from_utf8(output.stdout).unwrap();
        (output.status.code(), said)
    };
    let fig7 = ["experiment", "fig7", "--profile", "smoke"];
    for (out, more) in [("a", &[][..]), ("b", &[]), ("c", &["--seed", "2"])] {
        assert_eq!(run(&[&fig7[..], &["--out", out], more].concat()).0, Some(0));
    }
    assert_eq!(
        run(&["diff", "a", "b"]),
        (Some(0), "fig7: the same\n".to_owned())
    );
    let (code, said) = run(&["diff", "a/fig7", "c/fig7"]);
    assert_eq!(code, Some(1));
    assert!(said.contains("fig7: seed 1 -> 2\n"), "{said}");
    assert!(said.contains("fig7: summary.csv changed\n"), "{said}");
    assert_eq!(run(&["diff", "a", "nowhere"]).0, Some(2));

    let (code, said) = run(&["cache", "ls"]);
    assert!(code == Some(0) && said.contains("\npose-forest"), "{said}");
    let (_, verified) = run(&["cache", "verify"]);
    assert!(verified.ends_with(", 0 damaged\n"), "{verified}");
    let set = fs::read_dir(repository.path("data/cache/data-set")).unwrap();
    let set = set
        .map(|entry| entry.unwrap().path())
        .find(|p| p.join("entry.json").exists());
    fs::write(set.unwrap().join("joints.csv"), "altered").unwrap();
    let (code, verified) = run(&["cache", "verify"]);
    assert_eq!(code, Some(1));
    assert!(verified.contains("joints.csv has 7 bytes"), "{verified}");

    // No study asks for the second seed's. (Those that want more of Fig. 9 than these few objectives are
    // not asked.)
    for study in names(&repository.path("experiments")) {
        if !["fig7.toml", "fig9.toml"].contains(&study.as_str()) {
            fs::remove_file(repository.path("experiments").join(study)).unwrap();
        }
    }
    let kept = || {
        let stages = ["data-set", "pose-forest", "estimates"];
        stages.map(|stage| repository.cached(stage).len())
    };
    let before = kept();
    let (code, dry) = run(&["cache", "gc", "--dry-run"]);
    assert_eq!((code, kept()), (Some(0), before));
    assert_eq!(
        run(&["cache", "gc"]),
        (code, dry.replace("would remove", "removed"))
    );
    assert_eq!(kept(), before.map(|count| count / 2));
    let (_, forests) = run(&["cache", "ls", "pose-forest"]);
    assert_eq!(forests.matches("MSPD").count(), 3, "{forests}");
    // The altered set is made again.
    assert_eq!(run(&[&fig7[..], &["--out", "d"]].concat()).0, Some(0));
    assert_eq!(run(&["diff", "a", "d"]).0, Some(0));
}

/// Bounds from ten seeds hold the results of one; a result that is changed by hand is outside, unless it is
/// what bounds are made around.
#[test]
fn bounds_hold_what_they_were_made_from() {
    let repository = Repository::new();
    let run = |arguments: &[&str]| {
        let output = repository.command(arguments).output().unwrap();
        let said = text(&output.stdout);
        (output.status.code(), said, text(&output.stderr))
    };
    let (code, _, complaint) = run(&["bounds", "speed"]);
    assert_eq!(code, Some(2));
    assert!(complaint.contains("study speed does not say what is to be bounded"));
    assert_eq!(run(&["bounds", "fig2", "--seeds", "10"]).0, Some(0));
    assert_eq!(names(&repository.path("tests/bounds")), ["smoke.toml"]);
    let (code, _, complaint) = run(&["check"]);
    assert_eq!(code, Some(2));
    assert!(complaint.contains("run `armpose experiment all --profile smoke`"));

    let fig2 = ["experiment", "fig2", "--profile", "smoke"];
    assert_eq!(run(&fig2).0, Some(0));
    let (code, said, _) = run(&["check"]);
    assert_eq!(code, Some(0), "{said}");
    let file = "results/smoke/fig2/summary.csv";
    let summary = fs::read_to_string(repository.path(file)).unwrap();
    let line = summary.lines().nth(1).unwrap();
    let value = line.split(',').nth(2).unwrap();
    repository.edit(file, value, &format!("1{value}"));
    let (code, said, _) = run(&["check"]);
    assert_eq!((code, said.matches(" OUTSIDE ").count()), (Some(1), 1));
    assert_eq!(run(&["bounds", "fig2", "--as-it-is"]).0, Some(0));
    assert_eq!(run(&["check"]).0, Some(0));
}

#[test]
fn studies_are_listed_and_shown() {
    let here = Path::new(env!("CARGO_MANIFEST_DIR"));
    let run = |arguments: &[&str]| {
        let mut command = Command::new(env!("CARGO_BIN_EXE_armpose"));
        let output = command.args(arguments).current_dir(here).output().unwrap();
        assert_eq!(output.status.code(), Some(0), "{}", text(&output.stderr));
        text(&output.stdout)
    };
    let list = run(&["experiment", "list"]);
    let listed = list
        .lines()
        .skip(1)
        .filter_map(|l| l.split_whitespace().next());
    let files = names(&here.join("experiments"));
    let studies = files.iter().map(|file| file.trim_end_matches(".toml"));
    assert!(listed.eq(studies), "{list}");
    let folder = here.join("results/paper/fig9/claims.json");
    let claims: serde_json::Value =
        serde_json::from_str(&fs::read_to_string(folder).unwrap()).unwrap();
    let claims = claims.as_array().unwrap();
    let held = claims
        .iter()
        .filter(|c| c["verdict"] == "reproduced")
        .count();
    let row = list.lines().find(|l| l.starts_with("fig9 ")).unwrap();
    let verdicts = format!(" {held} of {}", claims.len());
    assert!(row.trim_end().ends_with(&verdicts), "{row}");

    let shown = run(&["experiment", "show", "fig9", "--set", "protocol.folds=4"]);
    assert!(shown.starts_with("fig9: "), "{shown}");
    assert!(shown.contains("\nfolds = 4\n"), "{shown}");
    assert!(shown.contains("\nfile: experiments/fig9.toml\n"), "{shown}");
}

#[test]
fn the_spread_over_seeds_is_told() {
    let repository = Repository::new();
    let arguments = [
        "experiment",
        "fig7",
        "--profile",
        "smoke",
        "--seeds",
        "1..2",
    ];
    let output = repository.command(&arguments).output().unwrap();
    assert!(output.status.success());
    let spread = fs::read_to_string(repository.path("results/seeds/fig7-spread.csv")).unwrap();
    assert!(spread.lines().count() > 2);
    for line in spread.lines().skip(1) {
        assert_eq!(line.split(',').rev().nth(4), Some("2"), "{line}");
    }
    let backwards = [&arguments[..5], &["2..1"]].concat();
    let output = repository.command(&backwards).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
}

/// The page of a run has every study, figure, table and claim of it, whatever they say, is well-formed, and
/// loads nothing.
#[test]
fn the_page_of_a_run_is_whole_and_loads_nothing() {
    let repository = Repository::new();
    repository.edit("experiments/fig9.toml", "\"mspd/forest\"", "\"mspd\"");
    let command = ["experiment", "fig7", "fig9", "--profile", "smoke"];
    assert!(
        repository
            .command(&command)
            .output()
            .unwrap()
            .status
            .success()
    );
    let nasty = "<script>alert('1 & 2')</script> \"src=\"http://a";
    let claims = repository.path("results/smoke/fig7/claims.json");
    let mut told: serde_json::Value = serde_json::from_slice(&fs::read(&claims).unwrap()).unwrap();
    told[0]["quote"] = nasty.into();
    fs::write(&claims, told.to_string()).unwrap();
    // A study that this repository does not know.
    copy(
        &repository.path("results/smoke/fig7"),
        &repository.path("results/smoke/other"),
    );
    let report = [
        "report",
        "--html",
        "page.html",
        "--results",
        "results/smoke",
    ];
    let output = repository.command(&report).output().unwrap();
    assert_eq!(text(&output.stderr), "");
    assert_eq!(text(&output.stdout), "wrote page.html\n");
    let page = fs::read_to_string(repository.path("page.html")).unwrap();

    assert_well_formed(&page);
    assert!(!page.contains("<script") && !page.contains("@import") && !page.contains("url("));
    for (attribute, start) in [(" src=\"", "data:image/"), (" href=\"", "#")] {
        let targets: Vec<&str> = page.split(attribute).skip(1).collect();
        assert!(!targets.is_empty());
        for target in targets {
            assert!(target.starts_with(start), "{attribute}{}", &target[..20]);
        }
    }
    assert!(page.contains("&lt;script&gt;alert(&#39;1 &amp; 2&#39;)&lt;/script&gt; &quot;src="));
    let section = |id: &str| {
        let start = page.find(&format!("<section id=\"{id}\">")).unwrap();
        let end = page[start..].find("</section>").unwrap();
        &page[start..start + end]
    };
    let escaped = |text: &str| {
        let text = text
            .replace('&', "&amp;")
            .replace('<', "&lt;")
            .replace('>', "&gt;");
        text.replace('"', "&quot;").replace('\'', "&#39;")
    };
    for (id, figures) in [("fig7", 1), ("fig9", 2), ("other", 1)] {
        let claims = repository
            .path("results/smoke")
            .join(id)
            .join("claims.json");
        let claims: Vec<serde_json::Value> =
            serde_json::from_slice(&fs::read(claims).unwrap()).unwrap();
        assert!(!claims.is_empty());
        for claim in claims {
            let quote = escaped(claim["quote"].as_str().unwrap());
            assert!(section(id).contains(&quote), "{id}: {quote}");
            let above = page.find("<main>").unwrap();
            assert!(page[..above].contains(&quote), "{id}: {quote}");
        }
        assert_eq!(section(id).matches("<img ").count(), figures);
        assert!(section(id).contains("summary.csv") && section(id).contains("BLAKE3"));
    }
    assert!(section("fig9").contains("joints.csv") && section("fig9").contains("visibility.csv"));

    let missing = ["report", "--html", "page.html", "--results", "nowhere"];
    let output = repository.command(&missing).output().unwrap();
    assert_eq!(output.status.code(), Some(2));
    assert!(text(&output.stderr).starts_with("armpose: cannot read nowhere"));
}

/// Every tag that is opened is closed, the last one first, and no id is there twice.
fn assert_well_formed(page: &str) {
    let (mut open, mut ids) = (Vec::new(), Vec::new());
    let body = page.split_once("</style>").unwrap().1;
    for tag in body.split('<').skip(1) {
        let (tag, _) = tag.split_once('>').expect("a tag ends");
        if let Some((_, id)) = tag.split_once(" id=\"") {
            ids.push(id.split('"').next().unwrap());
        }
        let name = tag.split([' ', '\n']).next().unwrap();
        if let Some(name) = name.strip_prefix('/') {
            let expected = open.pop();
            // The part with the style was left out.
            assert!(
                expected == Some(name) || ["head", "html"].contains(&name),
                "</{name}>"
            );
        } else if !["input", "img"].contains(&name) {
            open.push(name);
        }
    }
    assert!(open.is_empty(), "{open:?}");
    let all = ids.len();
    ids.sort();
    ids.dedup();
    assert_eq!(ids.len(), all);
}
