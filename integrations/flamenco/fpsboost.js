// Flamenco job type: raise the frame rate of a film, one task per part, and one that joins them.
//
// Put this file into the folder "scripts" beside the flamenco-manager executable, and start the Manager again. All
// workers need fpsboost in one version, and the folders of input and output on shared storage.

const JOB_TYPE = {
    label: "fpsboost",
    description: "Raise the frame rate of a video or an image sequence, part by part.",
    settings: [
        { key: "input", type: "string", subtype: "file_path", required: true,
          description: "Video, folder of images, or pattern such as shot_####.png" },
        { key: "output", type: "string", subtype: "file_path", required: true,
          description: "Video or folder of images. Parts go into a folder beside it, OUTPUT.parts, and stay there" },
        { key: "options", type: "string", default: "--factor 2",
          description: "Options of fpsboost, quoted as in a shell, such as --fps 60 --crf 16 --threads 8" },
        { key: "parts", type: "int32", default: 16, propargs: { min: 1, max: 9999 },
          description: "Number of parts; several for every worker, so that none waits long for the last one" },
        { key: "command", type: "string", default: "fpsboost", visible: "submission",
          description: "The program on the workers, by its name or path" },
    ],
};

function compileJob(job) {
    const settings = job.settings;
    if (settings.parts < 1) {
        throw "parts must be at least 1";
    }
    const options = shellSplit(settings.options);
    const joinTask = author.Task("join", "misc");
    for (let part = 1; part <= settings.parts; part++) {
        // a task that is started again goes on where it was, and a part that is there is left
        const chunk = ["--chunk", `${part}/${settings.parts}`, "--resume"];
        const task = authorTask(`part-${part}`, settings, [settings.input, settings.output].concat(chunk, options));
        job.addTask(task);
        joinTask.addDependency(task);
    }
    addCommand(joinTask, settings, ["join", settings.output, `${settings.output}.parts`]);
    job.addTask(joinTask);
}

function authorTask(name, settings, args) {
    const task = author.Task(name, "misc");
    addCommand(task, settings, args);
    return task;
}

function addCommand(task, settings, args) {
    task.addCommand(author.Command("exec", { exe: settings.command, args: args }));
}
